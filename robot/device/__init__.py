"""The launcher at a serial port: protocol, link, driver, settings, and the calibration of its strings."""
