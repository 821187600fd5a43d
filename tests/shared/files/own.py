"""A problem whose parts come as meshes."""

from __future__ import annotations

MODEL = """name = "{name}"

[units]
length = "mm"
angle = "deg"

[mesh]
file = "{name}.stl"
unit = "mm"
"""
PROBLEM = """title = "Own rod into own plate"

[units]
length = "mm"
angle = "deg"
speed = "mm/s"

[moving]
model = "rod.toml"
feature = "peg"

[fixed]
model = "plate.toml"
feature = "hole"

[goal]
depth = "full"

[clearance]
x = 0.2
y = 0.15

[start]
height = 1

[uncertainty.start]
x = 0.03
y = 0.03
z = 0
rx = 0.05
ry = 0.05
rz = 0.05

[uncertainty.velocity]
translation = 0.001
rotation = 0.001

[specification]
speed = 20
contact_force = 20
torque_limit = 1
friction = 0.3
termination_force = 2

[settings]
evidence = "certified"
max_tilt = 10
time_limit = 120
"""
