"""What people see of a calibration and do for it: its picture and figures, and corners clicked in a browser."""
