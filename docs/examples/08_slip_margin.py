"""
Slip margin over a recording
============================

How far is a grasp from sliding? The slip margin is friction times pressure minus shear, at the weakest place. Here a finger is dragged until it
slides; the margin reaches zero earlier, and the monitor reports it.
"""

import numpy as np

import palpate as pp
from palpate import simulation
from palpate.touch import Forces

pad = pp.HalfSpace(youngs_modulus=200e3, poissons_ratio=0.48)
taxels = pp.AreaArray(
    shape=(10, 10), pitch=1e-3, depth=1.5e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=100.0
)
skin = pp.Skin(pad, taxels)

stages = [
    simulation.Stage("press", 0.3, 1.0),
    simulation.Stage("drag", 1.0, 1.0, drag=0.95),
    simulation.Stage("slide", 0.3, 1.0, drag=1.0, move=(1e-3, 0.0)),
    simulation.Stage("lift", 0.2, 0.0),
]
monitor = pp.GraspMonitor(friction=0.5)
forces = Forces()
first_slide = None
with skin.track(friction=0.5) as tracker:
    for frame in simulation.stream(skin, stages, friction=0.5, radius=10e-3, rate=50.0, rng=np.random.default_rng(0)):
        touch = tracker.step(frame.readings, time=frame.time)
        forces.add(touch, monitor.update(touch))
        if first_slide is None and frame.sliding:
            first_slide = frame.time

# %%
# The reported events, and the true time at which the whole contact begins to slide.

for event in monitor.events:
    print(f"{event.time:.2f} s: {event.kind}")
print(f"in truth all of it slides from {first_slide:.2f} s on")

# %%
# The shear force meets friction times normal force where the margin reaches zero.

figure = forces.plot(events=monitor.events, title="A finger is dragged until it slides")
