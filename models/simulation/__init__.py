"""Many shots to many tracks, `simulate`, in the event engine or moved by MuJoCo; what the camera reports, `observe`."""
