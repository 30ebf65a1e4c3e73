"""The sensor: light on its pixels to digital numbers, EMVA 1288 release 4's linear model."""
