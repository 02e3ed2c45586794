"""Runs the program `equipoise`: replay and reconcile."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import warnings
from typing import Any, Dict, List, Optional, Tuple, Union

PROGRAM_VARIABLE = "EQUIPOISE_PROGRAM"
# Exit code: part of the data was rejected or is missing; the rest was used.
PARTLY_REJECTED = 3

StrPath = Union[str, "os.PathLike[str]"]
Span = Tuple[float, float]
Json = Dict[str, Any]


class ProgramError(Exception):
    """The program `equipoise` is missing or failed: the cause and the remedy."""


def find_program(program: Optional[StrPath] = None) -> str:
    """Path of `equipoise`: the argument, else EQUIPOISE_PROGRAM, else in PATH."""
    name = os.fspath(program or os.environ.get(PROGRAM_VARIABLE) or "equipoise")
    found = shutil.which(name)
    if found is None:
        raise ProgramError(
            f"program {name!r} not found: install Equipoise, add its folder to PATH, or set {PROGRAM_VARIABLE} or the "
            "argument `program` to its path"
        )
    return found


def run(program: Optional[StrPath], command: str, file: StrPath, options: Dict[str, Any]) -> str:
    """Standard output of `equipoise COMMAND --OPTION VALUE -- FILE`; options that are None are left out."""
    arguments: List[str] = [find_program(program), command]
    for option, value in options.items():
        if value is not None:
            text = f"{value[0]}:{value[1]}" if isinstance(value, (tuple, list)) else os.fspath(value)
            arguments += [f"--{option}", text]
    arguments += ["--json"] if command != "export" else []
    # After `--`, a name that begins with a hyphen is a file.
    arguments += ["--", os.fspath(file)]
    done = subprocess.run(arguments, stdin=subprocess.DEVNULL, capture_output=True, text=True, encoding="utf-8")
    message = done.stderr.strip()
    if done.returncode == PARTLY_REJECTED:
        warnings.warn(f"equipoise {command} {file}: part of the data was rejected or is missing. {message}", stacklevel=3)
    elif done.returncode != 0:
        raise ProgramError(message or f"equipoise {command} {file} ended with {done.returncode}")
    return done.stdout


def replay(
    samples: StrPath,
    *,
    config: Optional[StrPath] = None,
    model: Optional[StrPath] = None,
    work: Optional[Span] = None,
    out: Optional[StrPath] = None,
    program: Optional[StrPath] = None,
) -> Json:
    """Computes the states of a recording or capture again, and returns the summary of `equipoise replay --json`.

    The states are written to `out` (.mcap, .jsonl, .csv); `read_recording` reads an .mcap. `work`: begin and end, s.
    """
    summary: Json = json.loads(run(program, "replay", samples, {"config": config, "model": model, "work": work, "out": out}))
    return summary


def reconcile(
    samples: StrPath,
    *,
    config: Optional[StrPath] = None,
    model: Optional[StrPath] = None,
    identify: Optional[Span] = None,
    reference: Optional[Span] = None,
    work: Optional[Span] = None,
    out: Optional[StrPath] = None,
    program: Optional[StrPath] = None,
) -> Json:
    """The finding of `equipoise reconcile --json`: verdict, effects that the model lacks, gap before and after.

    Spans are begin and end in seconds since the recording's begin. Report and `model.toml` are written into the folder `out`.
    """
    spans = {"identify": identify, "reference": reference, "work": work}
    options = {"config": config, "model": model, **spans, "out": out}
    finding: Json = json.loads(run(program, "reconcile", samples, options))
    return finding
