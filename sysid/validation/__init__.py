"""MuJoCo and the event engine against the analytic spin models and published measurements: `sysid match`."""
