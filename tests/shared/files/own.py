"""Problems whose parts are told beside them, and one whose parts come as meshes."""

TASK = """title = "Own {moving} into own {fixed}"
[units]
length = "mm"
angle = "deg"
speed = "mm/s"
[moving]
model = "{moving}.toml"
feature = "peg"
[fixed]
model = "{fixed}.toml"
feature = "hole"
[goal]
depth = "full"
[clearance]
x = {x}
y = {y}
[start]
height = {height}
[uncertainty.start]
x = {position}
y = {position}
z = 0
rx = {angle}
ry = {angle}
rz = {angle}
[uncertainty.velocity]
translation = {translation}
rotation = {rotation}
[specification]
speed = 20
contact_force = 20
torque_limit = 1
friction = 0.3
termination_force = 2
[settings]
evidence = "certified"
max_tilt = {tilt}
time_limit = {limit}
"""
_ERRORS = {"position": 0.03, "angle": 0.05, "translation": 0.001, "rotation": 0.001}
PROBLEM = TASK.format(moving="rod", fixed="plate", x=0.2, y=0.15, height=1, tilt=10, limit=120, **_ERRORS)
