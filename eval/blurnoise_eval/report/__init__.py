"""A run read, drawn and written down: figures for print and one HTML page that answers the exposure question."""
