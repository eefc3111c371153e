"""The launcher at the end of a line: protocol, link, driver, settings, and the calibration of its strings."""
