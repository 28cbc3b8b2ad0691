"""What provokes notes, and what says whether their advice helped: gels that are pulled, presses, trackers, sessions, cells, fields and files."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate.microscopy import CellForces, Field, cell_forces, read_field
from palpate.recordings import read_recording, write_recording
from palpate.recordings.columns import columns_of, columns_of_text
from palpate.status import Status
from remedies._remedy import command, laid


@dataclass(frozen=True)
class Note:
    """Words of a note ({} is what is filled in), a call that says it, and the call that it advises.

    ``room`` is the module that has it, where others have the same words; ``given`` as in `Remedy`; ``right`` is what must be true of what the advised
    call returns; ``stays``: the note tells of what was assumed, and is said of the right answer too, so that only ``right`` tells. ``also``: modules
    that say the same words.
    """

    words: str
    said: Callable[[], Any]
    advised: Callable[[], Any]
    right: Callable[[Any], Any] | None = None
    room: str = ""
    given: Callable[[], Any] | None = None
    stays: bool = False
    also: tuple[str, ...] = ()


def texts(got: Any) -> str:
    """What is said: the notes of a result, the remarks of a run, the words of a command, lists of these."""
    if isinstance(got, str):
        return got
    if isinstance(got, tuple | list):
        return "\n".join(map(texts, got))
    return "\n".join(text for name in ("remarks", "notes", "assumed", "past") for text in getattr(got, name, ()))


def last(got: Any) -> Any:
    return got[-1] if isinstance(got, list) else got


def holds(*truth: float) -> Callable[[Any], bool]:
    """Whether the true net force lies in its interval (95 %), component by component (NaN: any)."""

    def right(got: Any) -> bool:
        low, high = (np.asarray(side) for side in last(got).interval(0.95, "force"))
        true = np.array(truth)
        return bool((np.isnan(true) | ((low <= true) & (true <= high))).all())

    return right


def near(*truth: float, within: float) -> Callable[[Any], bool]:
    """Whether the net force is the true one within so much of the largest component."""
    return lambda got: bool(np.abs(np.asarray(last(got).force) - truth).max() <= within * np.abs(truth).max())


def both(*all_: Callable[[Any], Any]) -> Callable[[Any], bool]:
    return lambda got: all(one(got) for one in all_)


def status_is(status: Status) -> Callable[[Any], bool]:
    return lambda got: int(last(got).status) == int(status)


# -- cells that pull on a gel ------------------------------------------------------------------------------------------------

GEL = pp.HalfSpace(youngs_modulus=1e4, poissons_ratio=0.5)
IN_PLANE = ["displacement_x", "displacement_y"]
#: Net force of the pulled patch below, along x [N]: 500 Pa on 12 cells of 1 square micrometre.
PATCH = 6e-9


@functools.cache
def patch() -> Any:
    """Displacements of a gel that is pulled along x, 1 % noise, and the noise."""
    skin = pp.Skin(GEL, pp.AreaArray(shape=(12, 12), pitch=1e-6, depth=0.0, channels=IN_PLANE))
    grid = skin.surface
    traction = np.zeros((3, *grid.shape))
    traction[0] = 500.0 * (np.hypot(grid.x[None, :], grid.axes[0][:, None]) < 1.6e-6)
    assert np.isclose(traction[0].sum() * grid.cell, PATCH)
    clean = np.asarray(skin.sense(traction))
    noise = 0.01 * float(np.abs(clean).max())
    return clean + noise * np.random.default_rng(3).standard_normal(clean.shape), noise


def pulled(*, noise: bool = False, correlation: float | None = None, **how: Any) -> pp.Touch:
    readings, std = patch()
    array = pp.AreaArray(
        shape=(12, 12),
        pitch=1e-6,
        depth=0.0,
        channels=IN_PLANE,
        noise=std if noise else None,
        noise_correlation=correlation or 0.0,
    )
    return pp.Skin(GEL, array, **how).reconstruct(readings, components=["x", "y"], method="tikhonov")


def pulled_much(noise: bool = False, **how: Any) -> pp.Touch:
    """A gel of more vectors than a matrix is made for; the limit is lowered, so that the case is quick."""
    from unittest import mock

    from palpate.inverse.linear.matrix_free import path

    with mock.patch.object(path, "LARGEST_DENSE_BLOCK", 0):
        readings, std = patch()
        array = pp.AreaArray(shape=(12, 12), pitch=1e-6, depth=0.0, channels=IN_PLANE, noise=std if noise else None)
        return pp.Skin(GEL, array, **{"nuisance": [], **how}).reconstruct(
            readings, components=["x", "y"], method="tikhonov"
        )


HELD = holds(PATCH, 0.0, 0.0)
DRIFT = "and a net force cannot be separated{}: the intervals allow for both. If the image cannot drift, pass Skin(..., nuisance=[])"
BLIND = "noise cannot be separated from traction{}, which explains the readings at every wavelength"


@functools.cache
def smooth() -> Any:
    """Stress under a smooth press, 1 % noise, its force [N], and the noise."""
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
    skin = pp.Skin(pad, stresses())
    x, y = np.meshgrid(*skin.surface.axes[::-1])
    traction = np.array([300.0, -200.0, 1000.0])[:, None, None] * np.exp(-((x / 3e-3) ** 2 + (y / 3e-3) ** 2))
    clean = np.asarray(skin.sense(traction))
    noise = 0.01 * np.abs(clean).max()
    force = traction.sum(axis=(1, 2)) * skin.surface.cell
    return pad, clean + noise * np.random.default_rng(0).standard_normal(clean.shape), force, noise


def stresses(noise: Any = None) -> pp.AreaArray:
    channels = ["stress_xz", "stress_yz", "stress_zz"]
    return pp.AreaArray(shape=(20, 20), pitch=1e-3, depth=2e-3, channels=channels, noise=noise)


def iterated(parameter: Any, noise: bool = False, rounds: int | None = None) -> pp.Touch:
    """A reconstruction by products alone; the limit of matrices is lowered, and the rule may try fewer parameters, so that the case is quick."""
    from unittest import mock

    from palpate.inverse.linear.matrix_free import path, rules

    pad, readings, _, std = smooth()
    tries = rules.ROUNDS if rounds is None else rounds
    with mock.patch.object(path, "LARGEST_DENSE_BLOCK", 0), mock.patch.object(rules, "ROUNDS", tries):
        skin = pp.Skin(pad, stresses(std if noise else None))
        return skin.reconstruct(readings, method=pp.Tikhonov(parameter=parameter) if parameter else "tikhonov")


# -- a ball that presses ------------------------------------------------------------------------------------------------------

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
LINE: dict[str, Any] = {"count": 15, "pitch": 1e-3, "depth": 1e-3, "channels": ["stress_xz", "stress_zz"]}
BARE = pp.Skin(PAD, pp.LineArray(**LINE))  # noise not known
#: Force on the line below, full press: along x and z [N/m].
PRESSED = (3.0, 10.0)


@functools.cache
def line() -> Any:
    skin = pp.Skin(PAD, pp.LineArray(**LINE, noise=5.0))
    return skin, np.asarray(skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0).sliding(0.3)))


def readings(*loads: float, offset: Any = 0.0, seed: int = 0) -> Any:
    """One frame of readings for each load, in parts of the full press, with noise."""
    _, full = line()
    rng = np.random.default_rng(seed)
    return np.array([f * full + offset + 5.0 * rng.standard_normal(full.shape) for f in loads])


def tracked(frames: Any, *, step: float = 0.02, tracker: Any = None, begin: float = 0.0, **how: Any) -> list[pp.Touch]:
    """Every touch of a tracker that is given these frames."""
    own = how.pop("skin", line()[0]).track(**how) if tracker is None else tracker
    try:
        return [own.step(frame, begin + step * i) for i, frame in enumerate(frames)]
    finally:
        if tracker is None:
            own.close()


def by_its_own_model(frames: Any) -> pp.Touch:
    """The last touch of a tracker that no single solve helps."""
    from unittest import mock

    from palpate.tracking.held import Held

    with mock.patch.object(Held, "hold"):
        return tracked(frames)[-1]


def one_frame(frame: Any, **how: Any) -> pp.Touch:
    return line()[0].reconstruct(frame, **how)


REST = [0.0] * 8
MISSING = np.full((1, 2, 15), np.nan)


def few_steps(*loads: float, **how: Any) -> list[pp.Touch]:
    """A tracker whose iteration may take few steps."""
    from unittest import mock

    from palpate.tracking import iteration
    from palpate.tracking.held import Held

    # without the models of a single solve, which would answer
    with mock.patch.object(iteration, "ITERATIONS", 15), mock.patch.object(Held, "hold"):
        return tracked(readings(0.0, 0.0, *loads), **how)


def impatient(method: str) -> pp.Touch:
    """Contact that only pushes, found by an iteration that gives up at once."""
    from unittest import mock

    from palpate.inverse.constrained import cone

    with mock.patch.multiple(
        cone, PATIENCE=-1, AFTER=-1, interior=lambda hessian, linear, cone, start, tolerance: (start, False)
    ):
        return one_frame(readings(1.0)[0], method=method)


def network(**how: Any) -> pp.Touch:
    """A ball of 1 N, 1 % noise, by a network whose smoothness hardly counts, or by another way."""
    channels = ["stress_xz", "stress_yz", "stress_zz"]
    skin = pp.Skin(PAD, pp.AreaArray(shape=(6, 6), pitch=1e-3, depth=1e-3, channels=channels))
    clean = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=2e-3, force=1.0)))
    return skin.reconstruct(
        clean + 0.01 * np.abs(clean).max() * np.random.default_rng(0).standard_normal(clean.shape), **how
    )


def anew() -> pp.Touch:
    """A zero that a finger spoilt, taken anew when the finger has gone."""
    tracker = line()[0].track(baseline=12)
    tracked(wandering(), tracker=tracker)
    tracker.rezero()
    return tracked(readings(*[0.0] * 10, 1.0, seed=1), tracker=tracker, begin=1.0)[-1]


def wide(**how: Any) -> pp.Touch:
    """Contact that reaches past both ends of the array."""
    skin = pp.Skin(PAD, pp.LineArray(**LINE, noise=5.0), **how)
    clean = np.asarray(skin.sense(pp.solutions.hertz_line(half_width=12e-3, force=100.0)))
    return skin.reconstruct(clean + 5.0 * np.random.default_rng(0).standard_normal(clean.shape))


def hiding(**how: Any) -> pp.Touch:
    """Contact that reaches all taxels of a small array, and could hide an offset of them."""
    array = pp.AreaArray(shape=(4, 4), pitch=1e-3, depth=1.5e-3, channels=["stress_zz"], noise=50.0)
    skin = pp.Skin(PAD, array, **how)
    clean = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=2e-3, force=0.1)))
    return skin.reconstruct(clean + 50.0 * np.random.default_rng(0).standard_normal(clean.shape))


def one_taxel(broken: bool) -> pp.Touch:
    """Nothing touches, and one taxel reads 200 times the noise; that taxel counts, or is said to be broken."""
    skin = pp.Skin(PAD, pp.AreaArray(shape=(4, 4), pitch=4e-3, depth=1e-3, channels=["stress_zz"], noise=20.0))
    frame = 20.0 * np.random.default_rng(0).standard_normal((1, 4, 4))
    frame[0, 1, 2] += 4000.0
    return (skin.masked(np.arange(16).reshape(4, 4) != 6) if broken else skin).reconstruct(frame)


def railed(masked: bool) -> list[pp.Touch]:
    """A stream in which nothing touches, and one taxel jumps to 200 times the noise; that taxel counts, or is left out."""
    skin = pp.Skin(PAD, pp.AreaArray(shape=(8, 8), pitch=4e-3, depth=1e-3, channels=["stress_zz"], noise=20.0))
    frames = 20.0 * np.random.default_rng(0).standard_normal((40, 1, 8, 8))
    frames[20:, 0, 3, 4] += 4000.0
    return tracked(frames, skin=skin.masked(np.arange(64).reshape(8, 8) != 28) if masked else skin, baseline=20)[20:]


def rezeroed(drifted: bool) -> list[pp.Touch]:
    """A zero that has moved like a light press for 80 s, the new zero where nothing touches, and a press."""
    tracker, off = line()[0].track(baseline=0, rezero=None), 0.3 * line()[1]
    found = tracked(readings(0.0, *[0.0] * 160, offset=off), step=0.5, tracker=tracker)
    if drifted:
        return found[-1:]
    tracker.rezero(frames=5)
    tracked(readings(*REST, offset=off, seed=1), tracker=tracker, begin=90.0)
    return tracked(readings(0.5, offset=off, seed=2), tracker=tracker, begin=95.0)


def offsets() -> Any:
    """Raw counts: a press on offsets that are larger than all it moves."""
    loads = [0.0] * 10 + [0.5, 1.0] + [0.0] * 4
    return readings(*loads, offset=4e4 * (1.0 + np.random.default_rng(1).random((2, 15))))


def standing() -> Any:
    """Offsets of either sign, twice as large as the press: noise explains each frame by itself."""
    loads = [*[0.0] * 16, *np.linspace(0.1, 1.0, 4), *[0.0] * 4]
    return readings(*loads, offset=2.0 * np.abs(line()[1]).max() * np.random.default_rng(3).standard_normal((2, 15)))


def archived(frames: Any, **how: Any) -> Any:
    recording = pp.Recording(readings=frames, channels=LINE["channels"], time=np.arange(len(frames)) / 50)
    return pp.reconstruct_recording(BARE, recording, "out.nc", overwrite=True, **how)


def pressed_at(frame: int, share: float = 1.0) -> Callable[[Any], bool]:
    """Whether the table of a run has the true force in its interval, in this frame."""

    def right(done: Any) -> bool:
        row = done.table.iloc[frame]
        return bool(row["force_z_low (N/m)"] <= 10.0 * share <= row["force_z_high (N/m)"])

    return right


def wandering() -> Any:
    """Twelve frames before a press, on the last six of which a finger begins to rest."""
    return readings(*[0.0] * 6, *np.linspace(0.005, 0.03, 6), 1.0, 1.0)


def commanded(line_: str) -> Callable[[], Any]:
    return command(f"{line_} --skin skin.toml --out out.nc --overwrite")


def raw_file() -> None:
    from skin_files import skin_text

    text = skin_text(15, channels=("stress_xz", "stress_zz"), depth="1 mm")
    laid(skin_toml=text)
    frames = offsets()
    write_recording(
        pp.Recording(readings=frames, channels=LINE["channels"], time=np.arange(len(frames)) / 50), "raw.nc"
    )


def touch_of_file(frame: int) -> Callable[[Any], bool]:
    def right(_: Any) -> bool:
        from palpate.recordings import read_touch

        force = np.asarray(read_touch("out.nc").force)[frame]
        return bool(np.abs(force - PRESSED).max() < 0.4)

    return right


def stopped(*, resume: bool) -> str:
    """A run that is stopped after its first piece; or what comes of it with --resume."""
    import contextlib
    import io
    from unittest import mock

    from palpate.recordings.zarrstream import ZarrStream

    line_ = "reconstruct raw.nc --skin skin.toml --baseline 10 --out t.zarr"
    if resume:
        return str(command(f"{line_} --resume")())
    add = ZarrStream.add

    def once(self: Any, start: int, piece: Any) -> None:
        add(self, start, piece)
        raise KeyboardInterrupt

    err = io.StringIO()
    with (
        mock.patch.object(ZarrStream, "add", once),
        contextlib.redirect_stderr(err),
        contextlib.suppress(KeyboardInterrupt, SystemExit),
    ):
        spoken(line_)
    return err.getvalue()


def spoken(line_: str) -> None:
    """A command whose words stay on the streams that are there."""
    import shlex
    from unittest import mock

    import command_line

    with mock.patch.object(command_line.typer.main, "get_command", command_line.tree):
        from palpate.cli import app

        app(shlex.split(line_), standalone_mode=False, prog_name="palpate")


def touch_of_zarr(_: Any) -> bool:
    from palpate.recordings import read_touch

    touch = read_touch("t.zarr")
    return len(touch.force) == 16 and bool(np.abs(np.asarray(touch.force)[11] - PRESSED).max() < 0.4)


def session(rezero: bool) -> Any:
    """A live view of readings that stand, or one whose zero is taken anew while nothing touches."""
    from palpate.live.session import Session

    frames = standing()
    touches: list[pp.Touch] = []
    tracker = BARE.track()

    def step(values: Any, time: float) -> pp.Touch:
        touches.append(tracker.step(values, time))
        return touches[-1]

    made = Session(
        BARE, lambda: zip(np.arange(24) / 50, frames), tracker, pp.GraspMonitor(), pace=False, pages=False, step=step
    )
    if rezero:
        made.rezero(10)
    made.run()
    made.stop()
    return made, touches


# -- balls over areas --------------------------------------------------------------------------------------------------------

SOFT = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.3)
BONDED = pp.BondedLayers([pp.Layer(thickness=3.5e-3, youngs_modulus=2e5, poissons_ratio=0.48)])


@functools.cache
def dots(bonded: bool) -> Any:
    """Dots under a ball of 2 N, 1 % noise, made on a finer surface than the one that is sought."""
    pad = BONDED if bonded else SOFT
    how = {"shape": (8, 8), "pitch": 2e-3, "depth": 0.5e-3 if bonded else 1e-3, "channels": IN_PLANE}
    fine = pp.Skin(pad, pp.AreaArray(**how), surface=pp.AreaGrid(shape=(32, 32), spacing=0.5e-3))
    clean = np.asarray(fine.sense(pp.solutions.hertz_point(contact_radius=3e-3, force=2.0).shifted(0.3e-3, -0.2e-3)))
    noise = 0.01 * float(np.abs(clean).max())
    values = clean + noise * np.random.default_rng(0).standard_normal(clean.shape)
    return pp.Skin(pad, pp.AreaArray(**how, noise=noise)), values, noise


def followed_dots() -> pp.Touch:
    skin, values, noise = dots(True)
    rng = np.random.default_rng(1)
    with skin.track() as tracker:
        for i in range(2):
            tracker.step(noise * rng.standard_normal(values.shape), 0.02 * i)
        return tracker.step(values, 0.04)


def dots_by_frame(bonded: bool, **how: Any) -> pp.Touch:
    skin, values, _ = dots(bonded)
    return skin.reconstruct(values, **how)


@functools.cache
def heights() -> Any:
    """Heights of a gel under a ball of 1 N, with 8 % noise that nobody states, and the array."""
    array = pp.AreaArray(shape=(5, 5), pitch=2e-3, depth=1e-3, channels=["displacement_z"])
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
    clean = np.asarray(pp.Skin(pad, array).sense(pp.solutions.hertz_point(contact_radius=2.5e-3, force=1.0)))
    noise = 0.08 * float(np.abs(clean).max())
    return pad, array, clean + noise * np.random.default_rng(0).standard_normal(clean.shape)


def height(**how: Any) -> pp.Touch:
    pad, array, values = heights()
    return pp.Skin(pad, array, **how).reconstruct(values)


@functools.cache
def soft() -> Any:
    """Heights of a half-space under a ball of 1 N, with 1 % noise, and its array."""
    how = {"shape": (9, 9), "pitch": 2e-3, "depth": 2e-3, "channels": ["displacement_z"]}
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
    fine = pp.Skin(pad, pp.AreaArray(**how), surface=pp.AreaGrid(shape=(60, 60), spacing=0.4e-3))
    clean = np.asarray(fine.sense(pp.solutions.hertz_point(contact_radius=4e-3, force=1.0)))
    noise = 0.01 * float(np.abs(clean).max())
    return pad, pp.AreaArray(**how, noise=noise), clean + noise * np.random.default_rng(0).standard_normal(clean.shape)


def weaker(**how: Any) -> pp.Touch:
    """A gel that is 35 % stiffer than it is said to be moves less under the same force."""
    pad, array, values = soft()
    touch = pp.Skin(pad, array, **how).reconstruct(values / 1.35)
    low, high = touch.interval(0.95, "force")
    assert how.get("uncertainty") or not low[2] < 1.0 < high[2]
    return touch


def ended(**how: Any) -> pp.Touch:
    """A ball of 1 N on taxels that read no more than 60 % of the largest reading, as their array says."""
    pad, array, values = soft()
    top = 0.6 * float(np.abs(values).max())
    skin = pp.Skin(pad, replace(array, limits=top))
    return skin.reconstruct(np.clip(values, -top, top), **how)


# -- a cell ------------------------------------------------------------------------------------------------------------------


@functools.cache
def adhesions() -> Any:
    """Displacements of three adhesions in balance, their strain energy and contractile moment."""
    import test_microscopy_cell as cells

    traction, u = cells.cell()
    made = cells.skin()
    x, y = np.meshgrid(made.surface.x, made.surface.y)
    moment = -float((traction[0] * x + traction[1] * y).sum()) * cells.PITCH**2
    trim = (made.surface.shape[0] - cells.COUNT) // 2
    inner = traction[:2, trim : trim + cells.COUNT, trim : trim + cells.COUNT]
    energy = 0.5 * float((inner * (u - u.mean(axis=(1, 2), keepdims=True))).sum()) * cells.PITCH**2
    return u, energy, moment


def cell(values: Any, gel: Any = None, *, noise: float = 2e-9, clean: bool = False, **how: Any) -> CellForces:
    """Forces of a cell from a field of displacements, or of ``how["field"]`` settings of it."""
    import test_microscopy_cell as cells

    field = cells.field_of(values, **how.pop("field", {}))
    if clean:
        field = field.without_outliers()
    given = {"drift": False, "noise": noise, "draws": 16, **how}
    return cell_forces(field, cells.GEL if gel is None else gel, **{k: v for k, v in given.items() if v is not None})


def told(forces: CellForces) -> bool:
    """Energy and contractile moment are the true ones within three standard deviations and 3 %."""
    _, energy, moment = adhesions()
    return all(
        abs(forces[name].value - true) <= 3.0 * forces[name].std + 0.03 * abs(true)
        for name, true in (("strain_energy", energy), ("contractile_moment", moment))
    )


def of_cell(words: str, wrong: Any, mended: Any, right: Any = told, **how: Any) -> Note:
    return Note(words, wrong, mended, right, room=how.pop("room", "microscopy.doubts"), **how)


U = functools.partial(lambda: adhesions()[0])
#: A gel that does not widen as it is pressed.
CORK = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.0)
UPSIDE = np.array([1.0, -1.0])[:, None, None]


def outlying() -> Any:
    u = np.array(U())
    u[0, 3, 16] += 1.2e-6
    return u


# -- fields of displacements -------------------------------------------------------------------------------------------------

DENT = np.zeros((10, 12))
DENT[2:5, 4:7] = 1.5


def saved() -> None:
    for name, values in (("u", DENT), ("v", 0.5 * DENT), ("vup", -0.5 * DENT)):
        np.save(f"{name}.npy", values)


def field(second: str = "v", **how: Any) -> Field:
    return read_field(["u.npy", f"{second}.npy"], **{"pixel": 1e-7, "unit": "px", "step": 8, **how})


def same_field(**how: Any) -> Callable[[Field], bool]:
    """The dent lies where it was, as it was."""

    def right(got: Field) -> bool:
        return bool(
            np.allclose(got.displacement, 1e-7 * np.stack([DENT, 0.5 * DENT]))
            and all(np.isclose(getattr(got, k), v).all() for k, v in how.items())
        )

    return right


# -- files that warn ---------------------------------------------------------------------------------------------------------


def warned(call: Callable[[], Any]) -> Callable[[], Any]:
    """What is warned of, and what the call returns."""

    def made() -> Any:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            got = call()
        return "\n".join(str(w.message) for w in caught), got

    return made


def three_lines(end: str) -> Any:
    """A recording as text whose last line was cut, or not."""
    Path("r.csv").write_text("time (s),stress_zz[0] (Pa),stress_zz[1] (Pa)\n0,1,2\n0.1,3,45" + end)
    return read_recording("r.csv")


def markers(*, mistaken: bool) -> Any:
    """Markers in three frames as a table; one line of them is another marker's, or is taken out."""
    rows = ["frame,id,x,y"]
    for frame in range(3):
        for m in range(36):
            x, y = 10.0 * (m % 6) + 0.1 * frame, 10.0 * (m // 6)
            if (frame, m) == (2, 14):
                x += 25.0
                if not mistaken:
                    continue
            rows.append(f"{frame},{m},{x},{y}")
    Path("t.csv").write_text("\n".join(rows) + "\n")
    return read_recording(
        "t.csv", mapping=columns_of(columns_of_text("frame=frame,marker=id,x=x,y=y,position_unit=1mm"), shape=None)
    )


def stuck(*, mended: bool) -> pp.Touch:
    """One taxel of an area that is stuck; then it measures again."""
    frame = readings(1.0)[0]
    if not mended:
        frame[1, 3] = 3e4
    return one_frame(frame)


def overloaded(load: float) -> list[pp.Touch]:
    """A press in parts of the full one, of a sensor that ends at a third of it."""
    top = 0.3 * float(np.abs(line()[1]).max())
    skin = pp.Skin(PAD, pp.LineArray(**LINE, noise=5.0, limits=(-top, top)))
    return tracked(np.clip(readings(0.0, 0.0, load), -top, top), skin=skin)[-1:]


def slow_press(rezeroed: bool) -> list[pp.Touch]:
    """Normal stress that grows evenly for 32 s; then a new zero, and a press."""
    tracker, grown = line()[0].track(), np.array([0.0, 400.0])[:, None]
    ramp = np.concatenate([readings(0.0, offset=k / 1600 * grown, seed=k) for k in range(1600)])
    found = tracked(ramp, tracker=tracker)
    if not rezeroed:
        return found[-1:]
    tracker.rezero(frames=5)
    tracked(readings(*REST, offset=grown, seed=1), tracker=tracker, begin=33.0)
    return tracked(readings(0.5, offset=grown, seed=2), tracker=tracker, begin=34.0)


def frozen(*, runs: bool) -> list[pp.Touch]:
    """A sensor that repeats one frame; then it goes on."""
    frames = np.concatenate([readings(*[0.0] * 60), np.repeat(readings(1.0, seed=5), 60, axis=0)])
    return tracked(np.concatenate([frames, readings(1.0, seed=6)]) if runs else frames)[-1:]
