"""palpate simulate: the readings of its contacts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from command_line import run
from palpate import solutions
from palpate.recordings import read_recording
from palpate.skin import Skin
from skin_files import skin_text

CONTACT = ("--size", "1 mm", "--x", "5.2 mm", "--force", "20 N/m", "--frames", "2")


def test_a_contact_is_sensed_exactly_also_beyond_the_surface(tmp_path: Path) -> None:
    (tmp_path / "skin.toml").write_text(skin_text(11))
    out = run("simulate", "--skin", "skin.toml", "--out", "r.npz", *CONTACT, cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    readings = read_recording(tmp_path / "r.npz").readings
    skin = Skin.from_file(tmp_path / "skin.toml")
    for frame, force in enumerate((10.0, 20.0)):
        exact = skin.sense(solutions.hertz_line(half_width=1e-3, force=force).shifted(5.2e-3))
        np.testing.assert_allclose(readings[frame], exact, rtol=1e-9)


def test_a_contact_on_a_creeping_pad_is_sensed_exactly(tmp_path: Path) -> None:
    text = skin_text(11, channels=["strain_zz"])
    (tmp_path / "elastic.toml").write_text(text)
    creep = '[pad]\nprony = [[0.5, "5 ms"]]\n'
    (tmp_path / "skin.toml").write_text(text.replace("[pad]\n", creep))
    out = run("simulate", "--skin", "skin.toml", "--out", "r.npz", *CONTACT, cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    readings = read_recording(tmp_path / "r.npz").readings
    skin = Skin.from_file(tmp_path / "elastic.toml")
    exact = np.asarray(skin.sense(solutions.hertz_line(half_width=1e-3, force=10.0).shifted(5.2e-3)))
    np.testing.assert_allclose(readings[0], exact, rtol=1e-9)
    assert (np.abs(readings[1]) > 2.05 * np.abs(exact)).all()
