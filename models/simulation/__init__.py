"""Many shots to many tracks: `simulate` in the event engine (models/engine) or here in MuJoCo, on `mujoco.batch`.

In: a model and shots. Out: tracks, and by `observe` what the camera reports of them.

    simulate, observe      in either engine; what the camera sees
    step                   `World`: a plain MjData advanced by a timestep, with every effect
    rollout, batch, act    MuJoCo: a step lands on the next switch or touch
    curve, touch, sampling where balls go between two steps, when they meet, and the samples asked for
    contact                three and more that touch at once, through MuJoCo's contacts
"""
