"""
Touch in a LeRobot episode
==========================

This script opens a robot's episode with raw tactile readings, reconstructs the touch, and adds wrench, slip margin and maps
for each video frame, from which a policy can learn.
"""

# sphinx_gallery_thumbnail_number = 1
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import palpate as pp
from palpate.lerobot import Episode, add_columns, read_dataset, tactile_columns, write_dataset

channels = ["stress_xz", "stress_yz", "stress_zz"]
array = pp.AreaArray(shape=(6, 6), pitch=2e-3, depth=1.5e-3, channels=channels, noise=60.0)
surface = pp.AreaGrid(shape=(14, 14), spacing=1e-3)
skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array, surface=surface)
folder = Path(tempfile.mkdtemp())

# %%
# What the robot recorded
# -----------------------
# Two seconds at 30 frames a second: the finger presses, is dragged, and lifts. Here the readings are simulated; the joint values are placeholders.

fps, friction = 30, 0.6
time = np.arange(2 * fps) / fps
rng = np.random.default_rng(0)
normal = 2.0 * np.clip(np.minimum(time / 0.5, (2.0 - time) / 0.5), 0.02, 1.0)
drag = friction * normal * np.clip((time - 0.5) / 1.0, 0.0, 0.95)
readings = np.stack(
    [
        skin.sense(
            pp.solutions.hertz_point(contact_radius=2.5e-3 * (f / 2.0) ** (1 / 3), force=f).partial_slip(friction, q),
            rng=rng,
        )
        for f, q in zip(normal, drag)
    ]
)
raw = {
    "observation.state": np.zeros((len(time), 7), dtype=np.float32),
    "observation.tactile.finger.readings": readings,
    "action": np.zeros((len(time), 7), dtype=np.float32),
}
write_dataset(folder / "recorded", [Episode(raw, task="press and drag")], fps=fps)

# %%
# Open, reconstruct, write back
# -----------------------------

dataset = read_dataset(folder / "recorded")
added = []
for episode in dataset.episodes:
    recording = episode.recording("finger", channels)
    touch = skin.reconstruct(recording.readings, friction=friction, time=np.arange(len(episode)) / dataset.fps)
    added.append(tactile_columns(touch, name="finger", friction=friction))
add_columns(folder / "recorded", folder / "with-touch", added)

# %%
# What a policy sees
# ------------------
# The original columns are unchanged, bit by bit.

again = read_dataset(folder / "with-touch").episodes[0].columns
for name, values in dataset.episodes[0].columns.items():
    assert np.array_equal(again[name], values), name
wrench = again["observation.tactile.finger.wrench"]
figure, ax = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
ax.plot(time, normal, color="0.7", lw=3, label="true")
ax.plot(time, drag, color="0.7", lw=3)
ax.plot(time, wrench[:, 2], label="normal")
ax.plot(time, wrench[:, 0], label="tangential")
ax.set(xlabel="time [s]", ylabel="force [N]")
ax.legend(frameon=False)
print({name: values.shape for name, values in again.items()})
plt.show()
