"""palpate demo camera: from nothing to a video and a picture beside the truth."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from command_line import run

pytest.importorskip("cv2")
pytest.importorskip("av")
for _name in ("typer", "pydantic", "h5netcdf", "matplotlib"):
    pytest.importorskip(_name)


@pytest.mark.long
def test_the_demo_finds_what_pressed(tmp_path: Path) -> None:
    done = run("demo", "camera", "--out", "d", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert {p.name for p in (tmp_path / "d").iterdir()} >= {"gel.toml", "press.mp4", "touch.nc", "touch.png"}
    said = [float(v) for v in re.findall(r"(?m)^  net force [xyz] +(-?[\d.]+) N", done.stdout)]
    found, true = said[:3], said[3:]
    assert found == pytest.approx(true, rel=0.1, abs=0.03)
    (tmp_path / "d" / "gel.toml").write_text("mine")
    assert "is kept" in run("demo", "camera", "--out", "d", cwd=tmp_path).stderr
