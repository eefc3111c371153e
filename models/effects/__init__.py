"""Effects, one a file, by what they act on: `cloth`, `impact`, `cue`, `camera`. The catalogue finds every one."""
