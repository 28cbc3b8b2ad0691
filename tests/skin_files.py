"""The text of a skin.toml for tests."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["SHEAR", "skin_text"]

#: Channels that tell shear and pressure apart on an area.
SHEAR = ("stress_xz", "stress_yz", "stress_zz")


def skin_text(
    *taxels: int,
    channels: Sequence[str] = ("stress_zz",),
    pitch: str = "1 mm",
    depth: str = "1.2 mm",
    noise: str | None = None,
    modulus: str = "200 kPa",
    ratio: float = 0.48,
) -> str:
    """A half-space with one plane: so many taxels on a line, or rows and columns on an area."""
    rows = f"count = {taxels[0]}" if len(taxels) == 1 else f"shape = [{taxels[0]}, {taxels[1]}]"
    names = ", ".join(f'"{c}"' for c in channels)
    return f"""\
[pad]
kind = "half_space"
youngs_modulus = "{modulus}"
poissons_ratio = {ratio}

[[plane]]
kind = "{"line" if len(taxels) == 1 else "area"}"
{rows}
pitch = "{pitch}"
depth = "{depth}"
channels = [{names}]
""" + (f'noise = "{noise}"\n' if noise else "")
