"""The table in closed form, compiled and without MuJoCo: cloth, impacts, jaws and cueing as formulas."""
