"""The table in closed form: cloth, impacts and cueing as formulas, and an event-driven simulator built of them.

Compiled, and independent of MuJoCo: it imports models.shot and nothing else of this project.
"""
