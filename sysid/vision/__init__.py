"""From high-speed video to clips: camera, detection, tracks, spin, cue."""
