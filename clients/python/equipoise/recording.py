"""Recordings as pandas tables and NumPy arrays, by `equipoise export`: the program decides which values are valid."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import tempfile
from typing import TYPE_CHECKING, Any, Dict, Iterable, Iterator, List, Optional, Sequence, Tuple, Union

from ._arrays import SHAPES
from ._messages import Joint
from ._names import find, joint_name
from .program import Span, StrPath, run

if TYPE_CHECKING:
    import pandas

    from ._arrays import Array

TIME = "t_s"
# Read in any case: without them a missing value has no reason.
ALWAYS = (TIME, "valid", "valid_names")
FOOTER = b"equipoise."
# Entries of the footer that are JSON.
PARSED = ("units", "names", "started_monotonic_ns", "started_unix_ns")
# A column's name (docs/export.md#tables): field, joint or segment or side, component.
COLUMN = re.compile(
    r"(?P<field>.+?)(_(?P<part>[A-Z][A-Za-z0-9]*|left|right))?(_(x|y|z|w|xx|xy|yy|abduction|axial_rotation|flexion))?"
)


def read_recording(
    path: StrPath,
    topic: str = "state",
    *,
    columns: Optional[Sequence[str]] = None,
    span: Optional[Span] = None,
    config: Optional[StrPath] = None,
    program: Optional[StrPath] = None,
) -> pandas.DataFrame:
    """The messages of a recording, a row each, indexed by their time `t_s`, s. Invalid values are missing, never 0.

    `topic`: `state`, `suit`, `ground` or `cycle`. States are computed by a replay if the recording has none, or with
    `config`. `columns`: of each column, field or part, `torque_nm_L5S1`; default all. `span`: begin and end, s. Names end
    with the unit; `attrs["units"]` has it too, other `attrs` are the facts of docs/export.md, among them `config_toml`.
    The path may also be that of a table which `equipoise export` has written, `.parquet`, for which no program is needed.
    """
    with _open(path, topic, span, config, program) as file:
        return _frame(file, file.read(columns=_select(file, columns)))


def iter_recording(
    path: StrPath,
    topic: str = "state",
    *,
    rows: int = 8192,
    columns: Optional[Sequence[str]] = None,
    span: Optional[Span] = None,
    config: Optional[StrPath] = None,
    program: Optional[StrPath] = None,
) -> Iterator[pandas.DataFrame]:
    """As `read_recording`, in tables of at most so many rows: for a recording that is larger than the memory."""
    with _open(path, topic, span, config, program) as file:
        import pyarrow  # type: ignore[import-untyped]

        for batch in file.iter_batches(batch_size=rows, columns=_select(file, columns)):
            yield _frame(file, pyarrow.Table.from_batches([batch]))


def to_numpy(frame: pandas.DataFrame, field: str, part: Union[Joint, str, None] = None) -> Array:
    """A field of a table as an array, a row each; invalid values are NaN.

    `to_numpy(states, "torque_nm", "RightKnee")` has three columns; `to_numpy(states, "torque_nm")` is row by joint by axis.
    `part` is the name of a joint, a segment or a side; an unknown one is refused.
    """
    names = list(map(str, frame.columns))
    field = find("field", field, (_parsed(name)[0] for name in names))
    if part is None:
        chosen = [name for name in names if _parsed(name)[0] == field]
    else:
        parts = [_parsed(name)[1] for name in names if _parsed(name)[0] == field]
        part = joint_name(part) if isinstance(part, Joint) else part
        part = find("joint" if "L5S1" in parts else f"segment or side of {field}", part, filter(None, parts))
        chosen = [name for name in names if _parsed(name) == (field, part)]
    array: Array = frame[chosen].to_numpy(dtype=float, na_value=float("nan"))
    if len(chosen) == 1:
        return array[:, 0]
    whole = SHAPES.get(field, ())
    return array.reshape(-1, *whole) if part is None and len(chosen) == math.prod(whole) else array


def _parsed(column: str) -> Tuple[str, str]:
    """Field of a column, and joint, segment or side."""
    found = COLUMN.fullmatch(column)
    return (found["field"], found["part"] or "") if found else (column, "")


def _select(file: Any, wanted: Optional[Iterable[str]]) -> Optional[List[str]]:
    """The columns of a file that are wanted, in its order; None for all."""
    if wanted is None:
        return None
    by_name: Dict[str, List[str]] = {}
    for column in file.schema_arrow.names:
        field, part = _parsed(column)
        for name in {column, field, f"{field}_{part}" if part else field}:
            by_name.setdefault(name, []).append(column)
    chosen = {column for name in wanted for column in by_name[find("column", name, by_name)]}
    return [column for column in file.schema_arrow.names if column in chosen or column in ALWAYS]


@contextlib.contextmanager
def _open(
    path: StrPath, topic: str, span: Optional[Span], config: Optional[StrPath], program: Optional[StrPath]
) -> Iterator[Any]:
    """The recording as an open Parquet file."""
    try:
        import pandas
        import pyarrow.parquet  # type: ignore[import-untyped]
    except ImportError as cause:
        raise ImportError(f"recordings need pandas and pyarrow: pip install 'equipoise[recordings]' ({cause})") from cause
    if os.fspath(path).endswith(".parquet"):
        if (topic, span, config) != ("state", None, None):
            raise ValueError(f"{path} is a table already: topic, span and config are those of the recording")
        with pyarrow.parquet.ParquetFile(path) as file:
            yield file
        return
    with tempfile.TemporaryDirectory(prefix="equipoise-") as folder:
        table = os.path.join(folder, "table.parquet")
        run(program, "export", path, {"out": table, "topic": topic, "span": span, "config": config})
        with pyarrow.parquet.ParquetFile(table) as file:
            yield file


def _frame(file: Any, table: Any) -> pandas.DataFrame:
    import pandas
    import pyarrow

    # pandas would turn whole numbers with gaps into doubles, which do not hold times in ns.
    whole = {pyarrow.uint64(): pandas.UInt64Dtype(), pyarrow.uint32(): pandas.UInt32Dtype()}
    frame: pandas.DataFrame = table.to_pandas(types_mapper=whole.get).set_index(TIME)
    for key, value in (file.schema_arrow.metadata or {}).items():
        if key.startswith(FOOTER):
            name, text = key[len(FOOTER) :].decode(), value.decode()
            frame.attrs[name] = json.loads(text) if name in PARSED else text
    return frame
