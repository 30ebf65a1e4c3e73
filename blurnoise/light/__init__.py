"""Light on its way to the sensor: lens, motion and whatever else changes it; :mod:`.effects` is the table."""
