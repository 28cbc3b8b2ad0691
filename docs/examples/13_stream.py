"""
A stream in which a taxel dies
==============================

A tracker solves frame after frame, in about a millisecond each. Here one taxel dies half way. The tracker detects this, leaves the taxel out
and reports it.
"""

import matplotlib.pyplot as plt
import numpy as np

import palpate as pp
from palpate import simulation

pad = pp.HalfSpace(youngs_modulus=200e3, poissons_ratio=0.48)
taxels = pp.AreaArray(
    shape=(10, 10), pitch=1e-3, depth=1.5e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=100.0
)
skin = pp.Skin(pad, taxels)
stages = [
    simulation.Stage("press", 0.4, 1.0),
    simulation.Stage("hold", 0.8, 1.0),
    simulation.Stage("drag", 0.6, 1.0, drag=0.5),
    simulation.Stage("lift", 0.4, 0.0),
]

times, forces, lows, highs, truths = [], [], [], [], []
said: dict[str, float] = {}
with skin.track(friction=0.6) as tracker:
    for frame in simulation.stream(skin, stages, friction=0.6, radius=10e-3, rate=50.0, rng=np.random.default_rng(0)):
        readings = np.array(frame.readings)
        if frame.time > 0.8:
            readings[:, 4, 5] = 0.0  # dead from here on
        touch = tracker.step(readings, time=frame.time)
        low, high = touch.interval(0.95, of="force")
        times.append(frame.time)
        forces.append(float(touch.force[2]))
        lows.append(float(low[2]))
        highs.append(float(high[2]))
        truths.append(float(frame.traction[2].sum()) * skin.surface.cell)
        for note in touch.notes:
            said.setdefault(note.split(" (")[0], frame.time)

for note, time in said.items():
    print(f"{time:.2f} s: {note}")

# %%
# The force and its 95 % band stay right after the fault.

fig, ax = plt.subplots(figsize=(7, 3.2), layout="constrained")
ax.fill_between(times, lows, highs, alpha=0.3, label="95 %")
ax.plot(times, forces, label="found")
ax.plot(times, truths, "k--", lw=1, label="truth")
ax.axvline(0.8, color="C3", lw=1, label="a taxel dies")
ax.set(xlabel="time (s)", ylabel="normal force (N)", title="The force stays right when a taxel dies")
ax.legend()
