"""Draw the rooms of palpate and the walk of a frame: `python docs/_rooms.py` writes docs/_static/rooms.png."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

#: Floors from the ground up; a room imports only from rooms to its left and from floors below.
FLOORS = {
    "ground": (
        *("errors", "_memory", "_files", "_threads", "status", "units", "_numbers", "_transforms"),
        *("_arrays", "_batches", "_extras", "_recall"),
    ),
    "physics": ("elastic", "solutions", "sensing", "solid", "measured"),
    "inversion": ("inverse", "comparison", "uncertainty", "_plot", "touch"),
    "streams and files": ("grasp", "tracking", "recordings", "network"),
    "front door": ("design", "calibrate", "identify", "_skin_properties", "skin"),
    "uses": (
        *("archives", "simulation", "pressing", "camera", "microscopy"),
        *("sensors", "edges", "pads", "paper", "bench"),
    ),
    "faces": ("live", "ros", "mujoco", "torch", "jax", "lerobot", "cli", "__main__"),
}
#: Rooms that a frame walks through, in this order.
WALK = ("recordings", "skin", "inverse", "touch", "recordings")
WIDTH, ROW, MARGIN = 10.0, 0.42, 1.75
SHADES = ("#eef1f4", "#dcebf7", "#fbe6d4", "#e3f1df", "#f7efc9", "#eee4f3", "#f4e1e4")


def rows(names: tuple[str, ...]) -> list[list[str]]:
    """Rooms of a floor in rows of six at the most."""
    count = -(-len(names) // 6)
    size = -(-len(names) // count)
    return [list(names[i : i + size]) for i in range(0, len(names), size)]


def box(axes: Axes, name: str, left: float, bottom: float, width: float, shade: str) -> None:
    walked = name in WALK
    axes.add_patch(
        FancyBboxPatch(
            (left + 0.05, bottom + 0.05),
            width - 0.1,
            ROW - 0.1,
            boxstyle="round,pad=0,rounding_size=0.06",
            facecolor=shade,
            edgecolor="#b03a2e" if walked else "#7f8c8d",
            linewidth=1.8 if walked else 0.8,
        )
    )
    axes.text(
        left + width / 2,
        bottom + ROW / 2,
        name + "".join(f"  {step}" for step, room in enumerate(WALK, 1) if room == name),
        ha="center",
        va="center",
        fontsize=9,
        family="monospace",
        weight="bold" if walked else "normal",
    )


def draw() -> Figure:
    """The picture of docs/architecture.md."""
    figure = Figure(figsize=(WIDTH, 5.2), layout="constrained")
    axes = figure.add_subplot()
    bottom = 0.0
    for (floor, names), shade in zip(FLOORS.items(), SHADES, strict=True):
        lines = rows(names)
        axes.text(MARGIN - 0.1, bottom + len(lines) * ROW / 2, floor, ha="right", va="center", fontsize=10)
        for line in lines:
            width = (WIDTH - MARGIN) / len(line)
            for i, name in enumerate(line):
                box(axes, name, MARGIN + i * width, bottom, width, shade)
            bottom += ROW
        bottom += 0.12
    axes.set(xlim=(0, WIDTH), ylim=(-0.05, bottom))
    axes.set_axis_off()
    figure.suptitle(
        "Rooms from the ground up: each imports only from below, or from its left. Red: the walk of a frame, 1 to 5",
        fontsize=11,
    )
    return figure


if __name__ == "__main__":
    draw().savefig(Path(__file__).parent / "_static" / "rooms.png", dpi=110)
