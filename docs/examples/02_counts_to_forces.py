"""
A CSV of raw counts: forces over time
=====================================

A driver writes one line per frame, ``timestamp_ms,x1,y1,z1,x2,...``, in raw counts with offsets. palpate makes a table of forces with intervals
and a figure with the events marked.
"""

from pathlib import Path
from tempfile import mkdtemp

import numpy as np

import palpate as pp
from palpate import simulation
from palpate.recordings import TableMapping, read_recording
from palpate.touch import Forces

folder = Path(mkdtemp())

# %%
# The sensor has 4 x 4 taxels of three axes at the base of a soft pad. One count is 8 Pa.

pad = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=300e3, poissons_ratio=0.48)])
channels = ["stress_xz", "stress_yz", "stress_zz"]
taxels = pp.AreaArray(shape=(4, 4), pitch=4.5e-3, depth=4e-3, aperture=3e-3, channels=channels)
skin = pp.Skin(pad, taxels)

# %%
# This step writes such a file: a finger rests, presses, drags until it slides, and lifts. Leave it out if you have a file.

rng = np.random.default_rng(0)
stages = [
    simulation.Stage("rest", 0.3, 0.0),
    simulation.Stage("press", 0.4, 2.0),
    simulation.Stage("drag", 0.5, 2.0, drag=0.8),
    simulation.Stage("slide", 0.3, 2.0, drag=1.0, move=(1e-3, 0.0)),
    simulation.Stage("lift", 0.3, 0.0),
]
offsets = rng.integers(-400, 400, size=(3, 4, 4))
titles = [f"{axis}{taxel}" for taxel in range(1, 17) for axis in "xyz"]
lines = ["timestamp_ms," + ",".join(titles)]
for frame in simulation.stream(skin, stages, friction=0.5, radius=8e-3, rate=50.0):
    counts = np.rint(frame.readings / 8.0 + offsets + rng.normal(0.0, 12.0, offsets.shape)).astype(int)
    lines.append(f"{1000 * frame.time:.0f}," + ",".join(map(str, counts.reshape(3, 16).T.ravel())))
(folder / "taxels.csv").write_text("\n".join(lines) + "\n")
print("\n".join(line[:60] + " ..." for line in lines[:3]))

# %%
# The meaning of the columns. A ``skin.toml`` has the same keys in its section ``[columns]``.

columns = TableMapping(
    time="timestamp_ms",
    time_scale=1e-3,
    channels={"stress_xz": "x{}", "stress_yz": "y{}", "stress_zz": "z{}"},
    scale=8.0,
    shape=(4, 4),
)
recording = read_recording(folder / "taxels.csv", mapping=columns)
print(recording.readings.shape, recording.channels)

# %%
# The first 15 frames give the zero; nothing may touch in them. Then a tracker solves each frame, and a monitor reports events.

monitor = pp.GraspMonitor(friction=0.6)
forces = Forces()
with skin.track(friction=0.6, baseline=15) as tracker:
    for time, readings in zip(recording.time, recording.readings, strict=True):
        touch = tracker.step(readings, time=float(time))
        forces.add(touch, monitor.update(touch))
forces.write(folder / "forces.csv")
print((folder / "forces.csv").read_text()[:300], "...")

# %%
# Normal and tangential force with their 95 % bands. The tangential force stops growing when the finger begins to slide.

figure = forces.plot(events=monitor.events, title="Raw counts of 16 taxels: a finger presses, drags and slides")
