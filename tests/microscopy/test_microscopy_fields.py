"""Displacement fields of other programs are read as they are meant, or refused with a remedy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from palpate.errors import InvalidInput, UncheckedInput
from palpate.microscopy import Field, is_field, read_field

PIXEL = 0.1e-6


@pytest.fixture
def pair() -> tuple[np.ndarray, np.ndarray]:
    """u and v [px] of a field that is not symmetric: a pull to the right in the upper left."""
    y, x = np.mgrid[:20, :28]
    bump = np.exp(-((x - 8) ** 2 + (y - 5) ** 2) / 8)
    return 1.5 * bump, -0.5 * np.roll(bump, 3, axis=1)


def same(field: Field, pair: tuple[np.ndarray, np.ndarray], tolerance: float = 1e-12) -> None:
    np.testing.assert_allclose(field.displacement, PIXEL * np.stack(pair), atol=tolerance * PIXEL)


def table(
    pair: tuple[np.ndarray, np.ndarray], step: float = 8, header: str = "", mark: str = " ", more: Any = None
) -> str:
    rows, columns = pair[0].shape
    lines = [header] if header else []
    for i in range(rows):
        for j in range(columns):
            extra = "" if more is None else f"{mark}{more[i, j]:g}"
            lines.append(
                mark.join(f"{n:.12g}" for n in (7.5 + step * j, 7.5 + step * i, pair[0][i, j], pair[1][i, j])) + extra
            )
    return "\n".join(lines) + "\n"


def test_numpy(tmp_path: Path, pair: tuple[np.ndarray, np.ndarray]) -> None:
    for name, one in zip("uv", pair):
        np.save(tmp_path / f"{name}.npy", one)
    np.save(tmp_path / "both.npy", np.stack(pair))
    np.save(tmp_path / "last.npy", np.stack(pair, axis=-1))
    np.savez(tmp_path / "both.npz", u=pair[0], v=pair[1], other=np.zeros(3))
    for source in (["u.npy", "v.npy"], ["both.npy"], ["last.npy"], ["both.npz"]):
        field = read_field([tmp_path / s for s in source], pixel=PIXEL, unit="px", step=8)
        same(field, pair)
        assert field.start == (3.5, 3.5)
    same(read_field(tmp_path / "both.npy", pixel=PIXEL, unit="um", step=8), (10 * pair[0], 10 * pair[1]))


def test_unit_and_step_are_never_guessed_of_a_matrix(tmp_path: Path, pair: tuple[np.ndarray, np.ndarray]) -> None:
    np.save(tmp_path / "both.npy", np.stack(pair))
    with pytest.raises(InvalidInput, match='give unit="px"'):
        read_field(tmp_path / "both.npy", pixel=PIXEL, step=8)
    with pytest.raises(InvalidInput, match="give step="):
        read_field(tmp_path / "both.npy", pixel=PIXEL, unit="px")
    field = read_field(tmp_path / "both.npy", pixel=PIXEL, unit="px", size=(224, 160))
    assert field.step == 8
    assert field.size == (224, 160)
    assert any("taken to cover the picture" in n for n in field.notes)
    with pytest.raises(InvalidInput, match="looks transposed"):
        read_field(tmp_path / "both.npy", pixel=PIXEL, unit="px", size=(160, 224))
    with pytest.raises(InvalidInput, match="a quarter of the field of view"):  # pixels called metres
        read_field(tmp_path / "both.npy", pixel=PIXEL, unit="m", step=8)


def test_matlab(tmp_path: Path, pair: tuple[np.ndarray, np.ndarray]) -> None:
    scipy.io.savemat(tmp_path / "plain.mat", {"u": pair[0], "v": pair[1], "info": "a cell"})
    scipy.io.savemat(tmp_path / "nested.mat", {"result": {"frame": {"ux": pair[0], "uy": pair[1]}}})
    for name in ("plain", "nested"):
        same(read_field(tmp_path / f"{name}.mat", pixel=PIXEL, unit="px", step=8), pair)
    y, x = np.mgrid[:20, :28] * 8.0
    cells = np.empty((2, 1), dtype=object)
    other = np.empty((2, 1), dtype=object)
    for i in range(2):
        cells[i, 0], other[i, 0] = pair[0] * (i + 1), pair[1] * (i + 1)
    scipy.io.savemat(
        tmp_path / "piv.mat", {"u_filtered": cells, "v_filtered": other, "u_original": cells, "v_original": other}
    )
    with pytest.raises(InvalidInput, match=r"4 fields.*u_filtered, v_filtered\(1\)"):
        read_field(tmp_path / "piv.mat", pixel=PIXEL, unit="px", step=8)
    same(
        read_field(tmp_path / "piv.mat", pixel=PIXEL, unit="px", step=8, name="u_filtered, v_filtered(2)"),
        (2 * pair[0], 2 * pair[1]),
    )
    frames = np.zeros((1, 2), dtype=[("pos", object), ("vec", object)])
    for i in range(2):
        frames[0, i] = (np.stack([x.ravel(), y.ravel()], 1), (i + 1) * np.stack([pair[0].ravel(), pair[1].ravel()], 1))
    scipy.io.savemat(tmp_path / "tfm.mat", {"displacement": frames})
    field = read_field(tmp_path / "tfm.mat", pixel=PIXEL, name="displacement(1).pos, displacement(1).vec")
    same(field, pair)
    assert any("taken as pixels" in n for n in field.notes)
    with pytest.raises(InvalidInput, match="no field 'w'"):
        read_field(tmp_path / "tfm.mat", pixel=PIXEL, name="w")
    whole = (tmp_path / "plain.mat").read_bytes()
    for cut in (60, 200, len(whole) // 2, len(whole) - 40):
        (tmp_path / "cut.mat").write_bytes(whole[:cut])
        with pytest.raises(InvalidInput, match=r"cannot be read as .mat|no displacement field"):
            read_field(tmp_path / "cut.mat", pixel=PIXEL, unit="px", step=8)


def test_matlab_73_is_kept_by_columns(tmp_path: Path, pair: tuple[np.ndarray, np.ndarray]) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "new.mat", "w", userblock_size=512) as file:
        group = file.create_group("result")
        group["u"], group["v"] = (one.T for one in pair)
    with (tmp_path / "new.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file")
    same(read_field(tmp_path / "new.mat", pixel=PIXEL, unit="px", step=8), pair)
    with h5py.File(tmp_path / "plain.h5", "w") as file:
        file["u"], file["v"] = pair
    same(read_field(tmp_path / "plain.h5", pixel=PIXEL, unit="px", step=8), pair)
    whole = (tmp_path / "new.mat").read_bytes()
    (tmp_path / "cut.mat").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InvalidInput, match=r"cannot be read as \.mat"):
        read_field(tmp_path / "cut.mat", pixel=PIXEL, unit="px", step=8)


@pytest.mark.parametrize(
    ("header", "mark", "ending"),
    [
        ("", " ", ".txt"),
        ("# x y u v flags", "\t", ".txt"),
        ("x [px], y [px], u [px/frame], v [px/frame], Vector type [-]", ",", ".txt"),
        ('TITLE = "a"\nVARIABLES = "x", "y", "u", "v", "flags"\nZONE I=28, J=20', " ", ".dat"),
        ("x;y;dx;dy;flag", ";", ".csv"),
    ],
)
def test_tables_of_piv_programs(
    tmp_path: Path, pair: tuple[np.ndarray, np.ndarray], header: str, mark: str, ending: str
) -> None:
    flags = np.zeros((20, 28)) + ("Vector type" in header)
    if header:
        flags[2, 3] = 5
    path = tmp_path / f"piv{ending}"
    path.write_text(table(pair, 8, header, mark, flags))
    field = read_field(path, pixel=PIXEL)
    assert (field.step, field.start, field.shape) == (8.0, (7.5, 7.5), (20, 28))
    there = field.valid
    assert np.array_equal(~there, (flags == 5))
    np.testing.assert_allclose(field.displacement[:, there], PIXEL * np.stack(pair)[:, there], atol=1e-12)
    assert any("pixels" in n for n in field.notes) or "[px]" in header
    # read from the bottom up, y and v the other way round: the same picture
    y = 159 - (7.5 + 8 * np.arange(20))
    lines = [header.partition("\n")[0]] if header.startswith("#") else []
    lines += [
        mark.join(f"{n:.12g}" for n in (7.5 + 8 * j, y[i], pair[0][i, j], -pair[1][i, j], flags[i, j]))
        for i in range(19, -1, -1)
        for j in range(28)
    ]
    if header.startswith("#") or not header:
        (tmp_path / "up.txt").write_text("\n".join(lines) + "\n")
        turned = read_field(tmp_path / "up.txt", pixel=PIXEL, up=True, size=(224, 160))
        np.testing.assert_allclose(turned.displacement, field.displacement, atol=1e-12)
        # without a picture the vectors alone have a place
        alone = read_field(tmp_path / "up.txt", pixel=PIXEL, up=True)
        np.testing.assert_allclose(alone.displacement, field.displacement, atol=1e-12)
        assert any("flipped about the middle" in n for n in alone.notes)


def test_units_in_a_header_hold(tmp_path: Path, pair: tuple[np.ndarray, np.ndarray]) -> None:
    um = [p * 0.1 for p in pair]
    path = tmp_path / "piv.txt"
    text = table((um[0], um[1]), 8).splitlines()
    scaled = [" ".join(f"{float(c) * (0.1 if k < 2 else 1):.12g}" for k, c in enumerate(line.split())) for line in text]
    path.write_text("x [um], y [um], u [um], v [um]\n" + "\n".join(scaled) + "\n")
    field = read_field(path, pixel=PIXEL)
    same(field, pair, 1e-9)
    assert field.step == pytest.approx(8.0)
    with pytest.raises(InvalidInput, match="leave out unit"):
        read_field(path, pixel=PIXEL, unit="px")
    for mu in ("\N{MICRO SIGN}m", "\N{GREEK SMALL LETTER MU}m"):
        path.write_text(f"x [{mu}], y [um], u [{mu}], v [{mu}]\n" + "\n".join(scaled) + "\n", encoding="utf-8")
        same(read_field(path, pixel=PIXEL), pair, 1e-9)
        same(read_field(path, pixel=PIXEL, unit=mu), pair, 1e-9)
    path.write_text("x [m] y [m] u [m/s] v [m/s]\n" + "\n".join(scaled) + "\n")
    with pytest.raises(InvalidInput, match="velocities"):
        read_field(path, pixel=PIXEL)


def test_v_alone_is_turned(tmp_path: Path, pair: tuple[np.ndarray, np.ndarray]) -> None:
    np.save(tmp_path / "u.npy", pair[0])
    np.save(tmp_path / "v.npy", -pair[1])
    (tmp_path / "t.txt").write_text(table((pair[0], -pair[1]), 8))
    same(read_field([tmp_path / "u.npy", tmp_path / "v.npy"], pixel=PIXEL, unit="px", step=8, v_up=True), pair)
    same(read_field(tmp_path / "t.txt", pixel=PIXEL, v_up=True), pair, 1e-11)
    with pytest.raises(InvalidInput, match="one of them"):
        read_field(tmp_path / "t.txt", pixel=PIXEL, v_up=True, up=True)


def test_positions_have_a_unit_of_their_own(tmp_path: Path, pair: tuple[np.ndarray, np.ndarray]) -> None:
    path = tmp_path / "t.txt"
    um = table((pair[0] * 0.1, pair[1] * 0.1), 8)
    path.write_text("x [px] y [px] u [um] v [um]\n" + um)
    field = read_field(path, pixel=PIXEL)
    same(field, pair, 1e-11)
    assert field.step == pytest.approx(8.0)
    path.write_text(um)  # the same without a word in the file
    same(read_field(path, pixel=PIXEL, unit="um", position_unit="px"), pair, 1e-11)
    told = read_field(path, pixel=PIXEL, unit="um")
    assert told.step == pytest.approx(80.0)
    assert any("position_unit=" in n for n in told.notes)
    mm = [
        " ".join(f"{float(c) * (1e-4 if k < 2 else 1):.12g}" for k, c in enumerate(line.split()))
        for line in table(pair, 8).splitlines()
    ]
    path.write_text("x (mm) y (mm) u (pixels/frame) v (pixels/frame)\n" + "\n".join(mm) + "\n")
    same(read_field(path, pixel=PIXEL), pair, 1e-11)
    path.write_text("x y u [um] v [um]\n" + um)
    with pytest.raises(InvalidInput, match="--position-unit px"):
        read_field(path, pixel=PIXEL)
    same(read_field(path, pixel=PIXEL, position_unit="px"), pair, 1e-11)
    path.write_text("x [px] y [px] u [um] v [px]\n" + um)
    with pytest.raises(InvalidInput, match="both in one unit"):
        read_field(path, pixel=PIXEL)


def test_units_that_files_of_matrices_state(tmp_path: Path, pair: tuple[np.ndarray, np.ndarray]) -> None:
    import scipy.io

    y, x = np.mgrid[:20, :28] * 8 + 7.5
    piv = {"x": x, "y": y, "u_filtered": pair[0], "v_filtered": pair[1]}
    path = tmp_path / "piv.mat"
    scipy.io.savemat(path, {**piv, "units": "[px] respectively [px/frame]"})
    same(read_field(path, pixel=PIXEL), pair)  # no unit= is needed
    with pytest.raises(InvalidInput, match="says that displacements are in px"):
        read_field(path, pixel=PIXEL, unit="um")
    scipy.io.savemat(path, {**piv, "units": "[m] respectively [m/s]"})
    with pytest.raises(InvalidInput, match="velocities"):
        read_field(path, pixel=PIXEL)
    um = {"x": x, "y": y, "u": pair[0] * 0.1, "v": pair[1] * 0.1}
    scipy.io.savemat(path, {"result": {**um, "units": "px; µm"}})
    same(read_field(path, pixel=PIXEL), pair, 1e-11)
    scipy.io.savemat(path, {**piv, "units": "kPa"})
    assert any("no length" in n for n in read_field(path, pixel=PIXEL, unit="px").notes)
    scipy.io.savemat(path, {**piv, "units": "[px] respectively [px/frame]", "calxy": 0.2e-6})
    assert any("0.2 um, and 0.1 um was given" in n for n in read_field(path, pixel=PIXEL).notes)
    np.savez(tmp_path / "t.npz", **um, units="px; um")
    same(read_field(tmp_path / "t.npz", pixel=PIXEL), pair, 1e-11)
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "t.h5", "w") as file:
        for key, values in um.items():
            file[key] = values
            file[key].attrs["units"] = "pixels" if key in "xy" else "micron"
    same(read_field(tmp_path / "t.h5", pixel=PIXEL), pair, 1e-11)


def test_a_frame_of_a_table_of_several_is_picked(tmp_path: Path, pair: tuple[np.ndarray, np.ndarray]) -> None:
    for header in ("x,y,u,v,frame", "ref_x,ref_y,disp_x,disp_y,frame"):
        rows = [f"{r},{k}" for k in (1, 2) for r in table((pair[0] * k, pair[1]), 8, "", ",").splitlines()]
        (tmp_path / "t.csv").write_text("\n".join([header, *rows]) + "\n")
        same(read_field(tmp_path / "t.csv", pixel=PIXEL, name="2"), (pair[0] * 2, pair[1]), 1e-11)
        with pytest.raises(InvalidInput, match=r"2 frames: '1', '2'.*--name"):
            read_field(tmp_path / "t.csv", pixel=PIXEL)
    (tmp_path / "t.txt").write_text(table(pair, 8))
    with pytest.raises(InvalidInput, match="leave out name"):
        read_field(tmp_path / "t.txt", pixel=PIXEL, name="2")


def test_numbers_with_a_decimal_comma(tmp_path: Path, pair: tuple[np.ndarray, np.ndarray]) -> None:
    for mark in (";", "\t"):
        (tmp_path / "t.csv").write_text(table(pair, 8, "x;y;u;v".replace(";", mark), mark).replace(".", ","))
        same(read_field(tmp_path / "t.csv", pixel=PIXEL), pair, 1e-11)


def test_matrices_of_text_and_tiff(tmp_path: Path, pair: tuple[np.ndarray, np.ndarray]) -> None:
    for name, one in zip("uv", pair):
        np.savetxt(tmp_path / f"{name}.csv", one, delimiter=",")
    same(read_field([tmp_path / "u.csv", tmp_path / "v.csv"], pixel=PIXEL, unit="px", step=8), pair)
    with pytest.raises(InvalidInput, match="Give both files"):
        read_field(tmp_path / "u.csv", pixel=PIXEL, unit="px", step=8)
    with pytest.raises(InvalidInput, match="same numbers"):
        read_field([tmp_path / "u.csv", tmp_path / "u.csv"], pixel=PIXEL, unit="px", step=8)
    np.savetxt(tmp_path / "t.csv", pair[1].T, delimiter=",")
    with pytest.raises(InvalidInput, match="transposed"):
        read_field([tmp_path / "u.csv", tmp_path / "t.csv"], pixel=PIXEL, unit="px", step=8)
    whole = (tmp_path / "u.csv").read_text()
    (tmp_path / "cut.csv").write_text(whole[: len(whole) // 2 + 40])
    with pytest.raises(InvalidInput, match="truncated"):
        read_field([tmp_path / "cut.csv", tmp_path / "v.csv"], pixel=PIXEL, unit="px", step=8)
    (tmp_path / "torn.csv").write_text(whole.rstrip("\n"))
    with pytest.warns(UncheckedInput):
        read_field([tmp_path / "torn.csv", tmp_path / "v.csv"], pixel=PIXEL, unit="px", step=8)
    tifffile = pytest.importorskip("tifffile")
    tifffile.imwrite(tmp_path / "both.tif", np.stack(pair).astype(np.float32), photometric="minisblack")
    same(read_field(tmp_path / "both.tif", pixel=PIXEL, unit="px", step=8), pair, 1e-6)
    assert is_field([tmp_path / "both.tif"])
    tifffile.imwrite(tmp_path / "one.tif", pair[0].astype(np.float32))
    with pytest.raises(InvalidInput, match="two pages or channels"):
        read_field(tmp_path / "one.tif", pixel=PIXEL, unit="px", step=8)
    tifffile.imwrite(tmp_path / "beads.tif", np.zeros((2, 40, 40), dtype=np.uint16), photometric="minisblack")
    with pytest.raises(InvalidInput, match="holds pictures"):
        read_field(tmp_path / "beads.tif", pixel=PIXEL, unit="px", step=8)
    assert not is_field([tmp_path / "beads.tif"])
    raw = (tmp_path / "both.tif").read_bytes()
    (tmp_path / "cut.tif").write_bytes(raw[: len(raw) // 2])
    with pytest.raises(InvalidInput, match="truncated"):
        read_field(tmp_path / "cut.tif", pixel=PIXEL, unit="px", step=8)


def test_what_is_missing_stays_missing(pair: tuple[np.ndarray, np.ndarray]) -> None:
    u = PIXEL * np.stack(pair)
    u[1, 4, 4] = np.nan
    field = Field(displacement=u, start=(3.5, 3.5), step=8.0, pixel=PIXEL)
    assert np.isnan(field.displacement[0, 4, 4])
    assert field.array().valid.sum() == 20 * 28 - 1
    with pytest.raises(InvalidInput, match="at least 16"):
        Field(displacement=np.full((2, 20, 28), np.nan), start=(3.5, 3.5), step=8.0, pixel=PIXEL)
    u[0, 0, 0] = np.inf
    with pytest.raises(InvalidInput, match="infinite"):
        Field(displacement=u, start=(3.5, 3.5), step=8.0, pixel=PIXEL)
    with pytest.raises(InvalidInput, match="neighbouring vectors differ"):
        Field(
            displacement=1e-6 * np.random.default_rng(0).standard_normal((2, 20, 28)),
            start=(3.5, 3.5),
            step=8.0,
            pixel=PIXEL,
        )


def test_drift_is_that_of_the_border(pair: tuple[np.ndarray, np.ndarray]) -> None:
    u = PIXEL * (np.stack(pair) + np.array([0.4, -0.7])[:, None, None])
    field = Field(displacement=u, start=(3.5, 3.5), step=8.0, pixel=PIXEL).without_drift()
    assert field.drift is not None
    np.testing.assert_allclose(field.drift, [0.4 * PIXEL, -0.7 * PIXEL], atol=0.01 * PIXEL)
    np.testing.assert_allclose(field.displacement, PIXEL * np.stack(pair), atol=0.01 * PIXEL)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.txt", "", "is empty"),
        ("a.foo", "1", "not known"),
        ("a.txt", "hello there\n", "no numbers"),
        ("a.txt", "1 2 3\n4 5 6\n", "x, y, u, v"),
        ("a.txt", "a b c d\n1 2 3 4\n", "do not say"),
        ("a.txt", "x y u v\n1 2 3 4\nx y u v\n1 2 3 4\n", "several fields"),
        ("a.npy", "nonsense", "cannot be read"),
        ("a.npz", "nonsense", "cannot be read"),
        ("a.mat", "nonsense", "cannot be read"),
        ("a.h5", "nonsense", "cannot be read"),
        ("a.txt", "x y u v\n" + "\n".join("1 2 3 4" for _ in range(20)) + "\n", "in a line or at one place"),
        ("a.txt", "x y u v\n" + "\n".join(f"{i} 2 3 4" for i in range(20)) + "\n", "in a line or at one place"),
    ],
)  # fmt: skip
def test_bad_files(tmp_path: Path, name: str, text: str, words: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InvalidInput, match=words):
        read_field(tmp_path / name, pixel=PIXEL, unit="px")


def test_vectors_at_the_beads_are_put_on_a_grid(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 200, (2, 600))
    u = 2 * np.exp(-((x - 100) ** 2 + (y - 100) ** 2) / 2000)
    (tmp_path / "beads.txt").write_text("x y u v\n" + "\n".join(f"{a} {b} {c} 0" for a, b, c in zip(x, y, u)) + "\n")
    field = read_field(tmp_path / "beads.txt", pixel=PIXEL)
    assert any("no regular positions" in n for n in field.notes)
    rows, columns = field.shape
    xx, yy = np.meshgrid(
        field.start[0] + field.step * np.arange(columns), field.start[1] + field.step * np.arange(rows)
    )
    true = 2 * np.exp(-((xx - 100) ** 2 + (yy - 100) ** 2) / 2000) * PIXEL
    assert np.abs(field.displacement[0] - true).max() < 0.05 * true.max()


PUBLISHED = Path(__file__).parents[1] / "data"


def test_published_fields_are_read() -> None:
    field = read_field(PUBLISHED / "beads_synthetic.csv", pixel=1e-6)
    assert (field.shape, field.start, field.step) == ((51, 51), (1.0, 1.0), 10.0)
    beads = read_field(PUBLISHED / "beads_axon.h5", pixel=1e-6 / 1.3, follow=True)
    assert any("no regular positions" in n for n in beads.notes)
    piv = read_field(PUBLISHED / "piv_particles.dat", pixel=1e-6)
    assert piv.std is not None
    assert (piv.shape, piv.start, piv.step) == ((24, 24), (305.0, 401.0), 4.0)


def test_errors_of_missing_vectors_are_no_noise_of_the_others(tmp_path: Path) -> None:
    u, std = np.zeros((2, 20, 30)), np.full((2, 20, 30), 2e-9)
    u[:, 3, 4], std[:, 3, 4] = np.nan, 1e-5  # as programs mark a vector
    field = Field(displacement=u, std=std, start=(3.5, 3.5), step=8.0, pixel=PIXEL)
    assert field.noise == pytest.approx(2e-9)
    u[:, 3, 4] = 0.5e-6
    marked = Field(displacement=u, std=std, start=(3.5, 3.5), step=8.0, pixel=PIXEL)
    assert marked.without_outliers().noise == pytest.approx(2e-9)
    # a table whose flag leaves vectors out, with an error of 99 px
    lines = ["x [px],y [px],u [px],v [px],ex [px],ey [px],flags"]
    lines += [f"{8 * (k % 6)},{8 * (k // 6)},0.1,{0.01 * k},{(e := 99 if k == 7 else 0.02)},{e},{int(k == 7)}" for k in range(36)]  # fmt: skip
    (tmp_path / "flags.csv").write_text("\n".join(lines) + "\n")
    assert read_field(tmp_path / "flags.csv", pixel=PIXEL).noise == pytest.approx(0.02 * PIXEL)


def test_infinite_errors_are_refused() -> None:
    u, std = np.zeros((2, 20, 30)), np.full((2, 20, 30), 2e-9)
    std[0, 3, 4] = np.inf
    with pytest.raises(InvalidInput, match="no negative or infinite values"):
        Field(displacement=u, std=std, start=(3.5, 3.5), step=8.0, pixel=PIXEL)


def test_a_name_is_not_ignored_where_there_is_nothing_to_pick(tmp_path: Path) -> None:
    np.save(tmp_path / "one.npy", np.random.default_rng(0).standard_normal((2, 20, 30)))
    with pytest.raises(InvalidInput, match="holds one field: leave out name='3'"):
        read_field(tmp_path / "one.npy", pixel=PIXEL, unit="px", step=8, name="3")
    tifffile = pytest.importorskip("tifffile")
    tifffile.imwrite(tmp_path / "one.tif", np.random.default_rng(0).standard_normal((2, 20, 30)).astype(np.float32))
    with pytest.raises(InvalidInput, match="holds one field: leave out name"):
        read_field(tmp_path / "one.tif", pixel=PIXEL, unit="px", step=8, name="3")


@pytest.mark.parametrize("shape", [(100,), (100, 1), (20, 20, 3)])
def test_components_that_are_no_matrices_need_positions(shape: tuple[int, ...], tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "list.mat", {"u": np.ones(shape), "v": np.ones(shape)})
    with pytest.raises(InvalidInput, match="and no positions"):
        read_field(tmp_path / "list.mat", pixel=PIXEL, unit="px", step=8)


def test_a_marker_moves_with_a_v_that_grows_upwards(pair: tuple[np.ndarray, np.ndarray], tmp_path: Path) -> None:
    """Rows grow downwards and v upwards: the moved marker lies at y - v."""
    for name, sign in (("down", 1), ("up", -1)):
        (tmp_path / f"{name}.csv").write_text(table((pair[0], sign * pair[1]), mark=","))
    down = read_field(tmp_path / "down.csv", pixel=PIXEL, follow=True)
    up = read_field(tmp_path / "up.csv", pixel=PIXEL, follow=True, v_up=True)
    np.testing.assert_allclose(up.displacement, down.displacement, atol=1e-12)
    assert up.start == pytest.approx(down.start)


def test_errors_and_depth_have_the_units_of_their_columns(tmp_path: Path) -> None:
    """Depth and errors in nanometres beside displacements in pixels are no pixels."""
    for errors, title in (("5,5,250", "ex [nm],ey [nm],w [nm]"), ("0.05,0.05,2.5", "ex [px],ey [px],w")):
        lines = [f"x [px],y [px],u [px],v [px],{title}"]
        lines += [f"{8 * (k % 6)},{8 * (k // 6)},{0.1 * (k % 5)},{0.02 * (k % 3)},{errors}" for k in range(36)]
        (tmp_path / "units.csv").write_text("\n".join(lines) + "\n")
        field = read_field(tmp_path / "units.csv", pixel=PIXEL)
        assert field.noise == pytest.approx(5e-9, rel=1e-9)
        np.testing.assert_allclose(field.normal, 250e-9)
    (tmp_path / "units.csv").write_text((tmp_path / "units.csv").read_text().replace("ey [px]", "ey [nm]"))
    with pytest.raises(InvalidInput, match="ex in px and ey in nm: export both in one unit"):
        read_field(tmp_path / "units.csv", pixel=PIXEL)


def test_attributes_state_the_units_of_errors_and_depth(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    rng = np.random.default_rng(0)
    with h5py.File(tmp_path / "field.h5", "w") as file:
        for name, unit, value in (("u", "px", 1.0), ("v", "px", 1.0), ("w", "um", 0.25), ("ex", "nm", 5), ("ey", "nm", 5)):  # fmt: skip
            file[name] = value + 0.01 * (name in "uv") * rng.standard_normal((20, 30))
            file[name].attrs["units"] = unit
    field = read_field(tmp_path / "field.h5", pixel=PIXEL, step=8)
    assert field.noise == pytest.approx(5e-9, rel=1e-9)
    np.testing.assert_allclose(field.normal, 250e-9)


@pytest.mark.parametrize("suffix", ["", "_filtered"])
def test_vectors_that_pivlab_interpolated_are_left_out_of_its_mat_files(suffix: str, tmp_path: Path) -> None:
    """Its tables mark them so too: both files of one field are read alike."""
    rng = np.random.default_rng(0)
    u, v = 0.3 * rng.standard_normal((2, 20, 30))
    kind = np.ones((20, 30))
    kind[3, 4], kind[5, 6] = 0, 2
    x, y = np.meshgrid(8.0 * np.arange(30), 8.0 * np.arange(20))
    names = {f"u{suffix}": u, f"v{suffix}": v, f"typevector{suffix}": kind}
    scipy.io.savemat(tmp_path / "field.mat", {"x": x, "y": y, **names})
    lines = ["x [px],y [px],u [px],v [px],Vector type [-]"]
    lines += [",".join(f"{n:.9g}" for n in row) for row in zip(*(np.ravel(p) for p in (x, y, u, v, kind)))]
    (tmp_path / "field.txt").write_text("\n".join(lines) + "\n")
    found = read_field(tmp_path / "field.mat", pixel=PIXEL, unit="px")
    told = read_field(tmp_path / "field.txt", pixel=PIXEL)
    assert found.left_out == told.left_out == 2
    np.testing.assert_allclose(found.displacement, told.displacement, rtol=1e-6)
    assert f"2 of 600 vectors are left out: typevector{suffix} marks them" in found.notes
