"""A shot as a Gymnasium environment: an action is a stroke, an observation where the balls are."""

from models import full_model
from planner import read_scene
from planner.environment import gymnasium_env

scene = read_scene("planner/example.toml")
env = gymnasium_env(scene, full_model(scene.table, scene.ball), seed=1)
observation, _ = env.reset(seed=1)
print("white lies at", observation["position"][0].round(3))
action = env.action_space.sample()
observation, reward, terminated, truncated, _ = env.step(action)
print(f"reward {reward:.2f}; white stopped at", observation["position"][0].round(3))
