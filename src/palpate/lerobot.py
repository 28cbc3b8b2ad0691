"""Touch in LeRobot's datasets (version 3.0): tactile columns beside cameras and joints, one row a video frame.

A sensor called NAME has columns ``observation.tactile.NAME.`` readings (channel, *array), traction (component,
*surface), std (the same), wrench (force and moment), slip_margin and time. Numbers are written and read without loss of precision. LeRobot's own loader opens the files; Parquet by pyarrow.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._extras import require
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, Unsupported
from palpate.recordings import Recording
from palpate.touch import Touch

__all__ = ["Dataset", "Episode", "add_columns", "read_dataset", "tactile_columns", "write_dataset"]

#: Version of the layout that is written, in LeRobot's notation.
VERSION = "v3.0"
PREFIX = "observation.tactile."
_FRAME = ("timestamp", "frame_index", "episode_index", "index", "task_index")
_KINDS = ("float32", "float64", "int64", "int32", "bool")
_DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_EPISODES = "meta/episodes/chunk-000/file-000.parquet"
#: Number of files in one folder.
CHUNK = 1000


@dataclass(frozen=True, eq=False)
class Episode:
    """Columns of one episode, each (frame, ...), by name; and the robot's task.

    Raises
    ------
    InvalidInput
        No columns, columns of different lengths or of a kind that the format does not have.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.lerobot import Episode
    >>> len(Episode({"action": np.zeros((50, 7), dtype=np.float32)}, task="pick"))
    50
    """

    columns: Mapping[str, npt.NDArray[Any]]
    task: str = ""

    def __post_init__(self) -> None:
        found = {str(name): np.asarray(value) for name, value in self.columns.items()}
        if not found:
            raise InvalidInput(
                "an episode needs at least one column, such as {'action': array (frame, ...)}; got none."
            )
        for name, value in found.items():
            if value.ndim == 0 or value.dtype.name not in _KINDS:
                raise InvalidInput(
                    f"column {name!r} must hold one entry for each frame, of {', '.join(_KINDS)}; got {value.dtype} of shape {value.shape}."
                )
            if value.ndim > 6:
                raise InvalidInput(
                    f"column {name!r} has {value.ndim - 1} axes after the frame axis; the LeRobot format allows at most 5. Reshape it to fewer axes."
                )
            if name in _FRAME:
                raise InvalidInput(f"column {name!r} is the format's own; leave it out.")
        lengths = {name: len(value) for name, value in found.items()}
        if len(set(lengths.values())) > 1 or not min(lengths.values()):
            raise InvalidInput(f"all columns must have one entry for each frame; their lengths are {lengths}.")
        object.__setattr__(self, "columns", found)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def recording(self, name: str, channels: Sequence[str]) -> Recording:
        """The readings of a sensor as a `palpate.Recording`, for `palpate.Skin.reconstruct` and `palpate.Tracker`."""
        key = f"{PREFIX}{name}.readings"
        if key not in self.columns:
            there = sorted({k.removeprefix(PREFIX).rsplit(".", 1)[0] for k in self.columns if k.startswith(PREFIX)})
            raise InvalidInput(
                f"the episode has no readings of {name!r}; its sensors are {', '.join(there) or 'none'}. Name one of these, or write readings with tactile_columns(touch, readings=...)."
            )
        time = self.columns.get(f"{PREFIX}{name}.time")
        return Recording(
            readings=self.columns[key], channels=tuple(channels), time=None if time is None else time.reshape(-1)
        )


@dataclass(frozen=True, eq=False)
class Dataset:
    """Episodes and their frame rate, as returned by `read_dataset`. ``videos`` are the columns stored in video files,
    which were not read.
    """

    episodes: list[Episode]
    fps: int
    robot_type: str | None = None
    videos: tuple[str, ...] = ()
    info: dict[str, Any] = field(default_factory=dict)


def tactile_columns(
    touch: Touch, *, name: str = "fingertip", readings: npt.ArrayLike | None = None, friction: float | None = None
) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of a reconstructed recording, one entry for each frame.

    Parameters
    ----------
    touch : Touch
        Has one batch axis, which is that of the frames.
    name : str
        Name of the sensor.
    readings : array (frame, channel, *array), optional
        Readings from which the touch was computed.
    friction : float, optional
        For the slip margin [Pa]; without it there is none.

    Returns
    -------
    mapping of column name to array
        readings unchanged; traction and std [Pa], (frame, component, *surface); wrench, forces then moments, in the
        axes of the touch; slip_margin; time [s], double precision (LeRobot's own timestamp is single).

    Raises
    ------
    InvalidInput
        A touch without frames, or readings with a different number of frames.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.lerobot import tactile_columns
    >>> grid = pp.LineGrid(count=4, spacing=1e-3)
    >>> touch = pp.Touch(np.ones((5, 2, 4)), grid, ("x", "z"), "tikhonov", time=np.arange(5) / 10)
    >>> columns = tactile_columns(touch, name="thumb", friction=0.5)
    >>> sorted(key.removeprefix("observation.tactile.thumb.") for key in columns)
    ['slip_margin', 'time', 'traction', 'wrench']
    """
    values = np.asarray(touch.values)
    if values.ndim != touch.surface.dimensions + 2:
        raise InvalidInput(
            f"touch must hold frames, values (frame, component, *surface); got shape {values.shape}: reconstruct readings (frame, channel, *array)."
        )
    frames = len(values)
    out: dict[str, npt.NDArray[Any]] = {"traction": values}
    if readings is not None:
        given = np.asarray(readings)
        if len(given) != frames:
            raise InvalidInput(
                f"readings must hold the {frames} frames of the touch; got {len(given)}. Pass the readings that the touch was reconstructed from."
            )
        out["readings"] = given
    if touch.has_intervals:
        out["std"] = np.asarray(touch.std())
    force, moment = np.asarray(touch.force), np.asarray(touch.moment)
    out["wrench"] = np.concatenate([force, moment.reshape(frames, -1)], axis=1)
    if friction is not None:
        out["slip_margin"] = np.asarray(touch.slip_margin(friction)).reshape(frames, 1)
    if touch.time is not None:
        out["time"] = np.asarray(touch.time, dtype=np.float64).reshape(frames, 1)
    return {f"{PREFIX}{name}.{key}": value for key, value in out.items()}


def write_dataset(path: str | Path, episodes: Sequence[Episode], *, fps: int, robot_type: str | None = None) -> Path:
    """Write a new dataset in LeRobot's layout, with one Parquet file for each episode.

    Raises
    ------
    InvalidInput
        No episodes, episodes with different columns, a rate that is not a positive whole number, or a folder that exists.
    Unsupported
        pyarrow is not installed.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from palpate.lerobot import Episode, read_dataset, write_dataset
    >>> episode = Episode({"action": np.arange(6.0).reshape(3, 2)}, task="press")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = write_dataset(f"{folder}/presses", [episode], fps=30)
    ...     read_dataset(path).episodes[0].columns["action"].tolist()
    [[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]]
    """
    require("LeRobot's datasets", "pyarrow")
    root = Path(path)
    if isinstance(fps, bool) or not isinstance(fps, int) or fps <= 0:
        raise InvalidInput(f"fps must be a positive whole number of frames a second; got {fps!r}.")
    if not episodes:
        raise InvalidInput("episodes is empty: give at least one Episode.")
    if root.exists():
        raise InvalidInput(f"{root} is there already: choose a new folder, or add_columns to a dataset.")
    first = _features(episodes[0])
    for number, episode in enumerate(episodes):
        if _features(episode) != first:
            raise InvalidInput(
                f"episode {number} has other columns, shapes or kinds than the first: a dataset has one set of columns. Give all episodes the same columns, or write two datasets."
            )
    tasks = list(dict.fromkeys(e.task for e in episodes))
    start, rows = 0, []
    for number, episode in enumerate(episodes):
        n = len(episode)
        index = np.arange(n)
        own: dict[str, npt.NDArray[Any]] = {
            "timestamp": (index / fps).astype(np.float32),
            "frame_index": index,
            "episode_index": np.full(n, number),
            "index": start + index,
            "task_index": np.full(n, tasks.index(episode.task)),
        }
        place = {"chunk_index": number // CHUNK, "file_index": number % CHUNK}
        _write_table(root / _DATA.format(**place), {**episode.columns, **own})
        rows.append(
            {
                "episode_index": number,
                "tasks": [episode.task],
                "length": n,
                **{f"data/{k}": v for k, v in place.items()},
                "dataset_from_index": start,
                "dataset_to_index": start + n,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
            }
        )
        start += n
    _write_rows(root / _EPISODES, rows)
    _write_tasks(root / "meta/tasks.parquet", tasks)
    own_features = {name: {"dtype": "int64", "shape": [1], "names": None} for name in _FRAME}
    own_features["timestamp"]["dtype"] = "float32"
    info = {
        "codebase_version": VERSION,
        "robot_type": robot_type,
        "total_episodes": len(episodes),
        "total_frames": start,
        "total_tasks": len(tasks),
        "chunks_size": CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": _DATA,
        "video_path": None,
        "features": {**first, **own_features},
    }
    _write_json(root / "meta/info.json", info)
    columns = {name: np.concatenate([e.columns[name] for e in episodes]) for name in first}
    _write_json(root / "meta/stats.json", {name: _statistics(value) for name, value in columns.items()})
    return root


def read_dataset(path: str | Path) -> Dataset:
    """Read all episodes of a dataset of version 3.0, without its videos.

    Raises
    ------
    InvalidInput
        The folder holds no dataset.
    Unsupported
        The dataset has another version, or pyarrow is not installed.
    """
    require("LeRobot's datasets", "pyarrow")
    import pyarrow.parquet as parquet

    root, info = Path(path), _info(path)
    features = {n: f for n, f in info["features"].items() if f["dtype"] not in ("video", "image")}
    names = [n for n in features if n not in _FRAME]
    tasks = _tasks(root)
    parts: dict[int, list[dict[str, Any]]] = {}
    task_of: dict[int, int] = {}
    for file in sorted((root / "data").rglob("*.parquet")):
        table = parquet.read_table(file)
        number = table["episode_index"].to_numpy()
        columns = {n: _array(table[n], features[n]) for n in names}
        task = table["task_index"].to_numpy()
        for episode in np.unique(number):
            where = number == episode
            parts.setdefault(int(episode), []).append({n: v[where] for n, v in columns.items()})
            task_of.setdefault(int(episode), int(task[np.flatnonzero(where)[0]]))
    found = [
        Episode({n: np.concatenate([p[n] for p in parts[e]]) for n in names}, task=tasks.get(task_of[e], ""))
        for e in sorted(parts)
    ]
    videos = tuple(n for n, f in info["features"].items() if f["dtype"] in ("video", "image"))
    return Dataset(found, int(info["fps"]), info.get("robot_type"), videos, info)


def add_columns(source: str | Path, target: str | Path, columns: Sequence[Mapping[str, npt.ArrayLike]]) -> Path:
    """Copy a dataset, including its videos, and add columns: one mapping for each episode, of arrays (frame, ...).

    Existing columns of the same name are replaced; everything else is copied as it is.

    Raises
    ------
    InvalidInput
        A different number of episodes or frames, or a target that exists.
    """
    require("LeRobot's datasets", "pyarrow")
    import pyarrow.parquet as parquet

    root, info = Path(target), _info(source)
    more = [Episode({n: np.asarray(v) for n, v in c.items()}) for c in columns]
    if len(more) != info["total_episodes"]:
        raise InvalidInput(f"columns must be given for each of {info['total_episodes']} episodes; got {len(more)}.")
    if len({json.dumps(_features(e)) for e in more}) > 1:
        raise InvalidInput(
            "the episodes have different columns, shapes or kinds: a dataset has one set of columns. Give the same columns for each."
        )
    if root.exists():
        raise InvalidInput(f"{root} is there already: choose a new folder.")
    files = sorted((Path(source) / "data").rglob("*.parquet"))
    count: dict[int, int] = {}
    for file in files:
        numbers, many = np.unique(
            parquet.read_table(file, columns=["episode_index"])["episode_index"], return_counts=True
        )
        for n, m in zip(numbers, many):
            count[int(n)] = count.get(int(n), 0) + int(m)
    for number, episode in enumerate(more):
        if count.get(number, 0) != len(episode):
            raise InvalidInput(
                f"episode {number} has {count.get(number, 0)} frames; its columns have {len(episode)}. Give one entry for each frame."
            )
    shutil.copytree(source, root)
    for file in sorted((root / "data").rglob("*.parquet")):
        table = parquet.read_table(file)
        number, frame = table["episode_index"].to_numpy(), table["frame_index"].to_numpy()
        for name in more[0].columns:
            value = np.stack([more[int(n)].columns[name][int(f)] for n, f in zip(number, frame)])
            if name in table.column_names:
                table = table.set_column(table.column_names.index(name), name, _list(value))
            else:
                table = table.append_column(name, _list(value))
        # statistics that another library computed for the old columns are no longer valid
        parquet.write_table(table.replace_schema_metadata(None), file)
    info["features"] = {**info["features"], **_features(more[0])}
    _write_json(root / "meta/info.json", info)
    stats = root / "meta/stats.json"
    said = json.loads(stats.read_text(encoding="utf-8")) if stats.exists() else {}
    for name in more[0].columns:
        said[name] = _statistics(np.concatenate([e.columns[name] for e in more]))
    _write_json(stats, said)
    return root


# -- files ------------------------------------------------------------------------------------------------------------


def _features(episode: Episode) -> dict[str, Any]:
    return {
        name: {"dtype": value.dtype.name, "shape": list(value.shape[1:]) or [1], "names": None}
        for name, value in episode.columns.items()
    }


def _list(value: npt.NDArray[Any]) -> Any:
    """Return an Arrow array of nested lists, one for each frame; a column with one number per frame is stored as
    numbers, as LeRobot does.
    """
    import pyarrow

    flat = pyarrow.array(np.ascontiguousarray(value).reshape(-1))
    shape = value.shape[1:]
    if shape in ((), (1,)):
        return flat
    for size in reversed(shape):
        if size == 0:
            raise InvalidInput(
                f"a column has shape {value.shape}, and the format cannot hold an axis of length 0. Leave the column out."
            )
        flat = pyarrow.ListArray.from_arrays(pyarrow.array(np.arange(0, len(flat) + 1, size, dtype=np.int32)), flat)
    return flat


def _array(column: Any, feature: Mapping[str, Any]) -> npt.NDArray[Any]:
    """Convert nested lists to an array (frame, *shape) of the type that the dataset states."""
    flat, depth = column.combine_chunks(), 0
    count = len(flat)
    while hasattr(flat, "flatten") and str(flat.type).startswith(
        ("list", "fixed_size_list", "large_list", "extension")
    ):
        flat = flat.storage if str(flat.type).startswith("extension") else flat.flatten()
        depth += 1
    values = flat.to_numpy(zero_copy_only=False)
    shape = tuple(feature["shape"])
    return np.asarray(values, dtype=feature["dtype"]).reshape(count, *shape)


def _write_table(path: Path, columns: Mapping[str, npt.NDArray[Any]]) -> None:
    import pyarrow
    import pyarrow.parquet as parquet

    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(pyarrow.table({name: _list(value) for name, value in columns.items()}), path)


def _write_rows(path: Path, rows: list[dict[str, Any]]) -> None:
    import pyarrow
    import pyarrow.parquet as parquet

    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(pyarrow.Table.from_pylist(rows), path)


def _write_tasks(path: Path, tasks: list[str]) -> None:
    """Write the tasks as the index of a pandas table, in which LeRobot looks them up."""
    import pandas

    pandas.DataFrame({"task_index": range(len(tasks))}, index=pandas.Index(tasks, name="task")).to_parquet(path)


def _tasks(root: Path) -> dict[int, str]:
    import pandas

    path = root / "meta/tasks.parquet"
    if not path.exists():
        return {}
    table = pandas.read_parquet(path)
    return {int(i): str(name) for name, i in table["task_index"].items()}


def _write_json(path: Path, value: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value, indent=4, ensure_ascii=False), encoding="utf-8")


def _info(path: str | Path) -> dict[str, Any]:
    file = Path(path) / "meta/info.json"
    if not file.is_file():
        raise InvalidInput(
            f"{path} holds no LeRobot dataset: there is no meta/info.json. Give the folder that holds meta/ and data/."
        )
    info = dict(json.loads(file.read_text(encoding="utf-8")))
    if info.get("codebase_version") != VERSION:
        raise Unsupported(
            f"{path} is of LeRobot's version {info.get('codebase_version')}, and {VERSION} is read: convert it by LeRobot's own "
            "lerobot.datasets.v30.convert_dataset_v21_to_v30."
        )
    return info


def _statistics(value: npt.NDArray[Any]) -> dict[str, Any]:
    """Return statistics over the frames, without missing ones."""
    numbers: Floats = value.astype(np.float64).reshape(len(value), *(value.shape[1:] or (1,)))
    there = np.isfinite(numbers)
    count = np.maximum(there.sum(axis=0), 1)
    filled = np.where(there, numbers, 0.0)
    mean = filled.sum(axis=0) / count
    std = np.sqrt((np.where(there, numbers - mean, 0.0) ** 2).sum(axis=0) / count)
    low, high = np.where(there, numbers, math.inf).min(axis=0), np.where(there, numbers, -math.inf).max(axis=0)
    none = ~there.any(axis=0)
    return {
        "min": np.where(none, 0.0, low).tolist(),
        "max": np.where(none, 0.0, high).tolist(),
        "mean": mean.tolist(),
        "std": std.tolist(),
        "count": [len(value)],
    }
