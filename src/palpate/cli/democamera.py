"""palpate demo camera: write a video of a gel with dots, and compute what pressed it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import typer

from palpate.cli.files import provenance, save_figure, write_text
from palpate.cli.progress import progress

__all__ = ["FILES", "demo_camera"]

#: Names of the files that the demo writes.
FILES = ("gel.toml", "press.mp4", "touch.nc", "touch.png")

_GEL = """\
# A silicone gel with printed dots, glued to a window in front of a camera, as written by palpate demo camera.
[pad]
kind = "bonded_layers"

[[pad.layer]]
thickness = "3.5 mm"
youngs_modulus = "300 kPa"
poissons_ratio = 0.48

[[plane]]
kind = "scattered"              # dots are found in the pictures
depth = "0.5 mm"
channels = ["displacement_x", "displacement_y"]

[camera]
pitch = "2 mm"                  # from the dots: scale of the picture
distance = "25 mm"              # from the lens to the dots
"""


def demo_camera(folder: Path, seed: int, own: Callable[[str], None]) -> None:
    """Render a video of a ball that presses and drags, and recover the touch from the video."""
    import numpy as np

    from palpate import solutions
    from palpate.camera import Dots, Looks, Scene, dot_grid, follow, overlay, write_video
    from palpate.elastic import BondedLayers, Layer
    from palpate.recordings import write_touch
    from palpate.touch import Touch

    write_text(folder / "gel.toml", _GEL)
    own("gel.toml")
    gel = BondedLayers([Layer(thickness=3.5e-3, youngs_modulus=300e3, poissons_ratio=0.48)])
    rng = np.random.default_rng(seed)
    scene = Scene(
        pad=gel,
        depth=0.5e-3,
        print=Dots(dot_grid((6, 8), 2e-3, jitter=2e-5, rng=rng), 0.8e-3, halved=(9,)),
        size=(320, 240),
        scale=0.055e-3,
        distance=25e-3,
        looks=Looks(colour=0.7, shading=0.4),
    )
    ball = scene.skin.sample(solutions.hertz_point(contact_radius=2.5e-3, force=1.5).shifted(1.5e-3, 1e-3))
    drag = scene.skin.sample(
        solutions.hertz_point(contact_radius=2.5e-3, force=1.5).shifted(1.5e-3, 1e-3).sliding(0.4, direction=0.5)
    )
    # rest, press, drag, release
    story = [0.0 * ball] * 6 + [p * ball for p in (0.2, 0.4, 0.6, 0.8, 1.0)]
    story += [ball + p * (drag - ball) for p in (0.2, 0.4, 0.6, 0.8, 1.0)] + [drag] * 3 + [0.0 * ball] * 2
    pictures = [scene.picture(part, rng=rng) for part in progress(story, "filming")]
    write_video(folder / "press.mp4", pictures, rate=30.0)
    own("press.mp4")
    with follow(folder / "press.mp4", folder / "gel.toml", track=False, every=18, friction=0.4) as touches:
        found, image = None, None
        for found in touches:  # noqa: B007
            image = touches.last.image if touches.last is not None else None
        view, dots = touches.readings.view, len(touches.readings.positions)
    truth = Touch(drag, scene.surface, ("x", "y", "z"), "known")
    if found is None or image is None:
        return
    write_touch(found, folder / "touch.nc", provenance=provenance(_GEL))
    own("touch.nc")
    save_figure(
        overlay(image, found, view, truth=truth, title="A ball pressed and dragged: found in the video, and true"),
        folder / "touch.png",
    )
    own("touch.png")
    typer.echo(
        f"A ball presses with 1.5 N and drags with 0.6 N; {len(pictures)} pictures of {dots} dots, one of them half lost."
    )
    for name, one in (("recovered", found), ("true", truth)):
        typer.echo(f"{name}:")
        typer.echo("\n".join(f"  {line}" for line in one.summary(friction=0.4).splitlines()))
    typer.echo(f"video           {folder / 'press.mp4'}")
    typer.echo(f"picture         {folder / 'touch.png'}")
    typer.echo(f"try next        palpate track {folder / 'press.mp4'} --skin {folder / 'gel.toml'} --fast")
