"""The shot as an environment for learning: a dm_control task, and the same with the interface of Gymnasium."""
