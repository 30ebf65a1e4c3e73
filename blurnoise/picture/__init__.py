"""Pictures made of digital numbers; :mod:`.steps` is the table."""
