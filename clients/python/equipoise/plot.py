"""Plots of recordings and findings, by matplotlib. Invalid spans are gaps, shaded in a row for each validity flag."""

from __future__ import annotations

from typing import TYPE_CHECKING, Dict, Iterable, List, Optional, Tuple, Union

from ._arrays import INVALIDATED_BY
from ._messages import Joint, Reason
from ._names import joint_name, joint_of
from .program import Json
from .recording import to_numpy

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ._arrays import Array

MM_PER_M = 1000.0


def torque(states: pandas.DataFrame, joint: Union[Joint, str], ax: Optional[Axes] = None) -> Axes:
    """Magnitude of a joint's overload torque ± σ against its limit, N m."""
    import numpy

    name = joint_name(joint_of(joint))
    size = numpy.linalg.norm(to_numpy(states, "torque_nm", name), axis=1)
    sigma, limit = to_numpy(states, "torque_sigma_nm", name), to_numpy(states, "torque_limit_nm", name)
    ax = ax or _subplots(1)[1][0]
    time = states.index.to_numpy()
    _band(ax, time, size, sigma, "torque ± σ")
    ax.plot(time, limit, "r--", label="limit")
    _shade(ax, states, numpy.isnan(size), ("torque_nm",))
    ax.margins(y=0.15)
    ax.set(title=f"Overload torque, {name}", xlabel="t, s", ylabel="N m")
    ax.legend(loc="upper right", fontsize="small")
    return ax


def cop(states: pandas.DataFrame) -> Figure:
    """Centre of pressure, measured against estimated ± σ, mm: forward (x) above sideways (y)."""
    import numpy

    figure, axes = _subplots(2)
    time = states.index.to_numpy()
    fields = ("cop_measured_m", "cop_estimated_m", "cop_sigma_m")
    measured, estimated, sigma = (MM_PER_M * to_numpy(states, field) for field in fields)
    for axis, (ax, name) in enumerate(zip(axes, ("forward (x)", "sideways (y)"))):
        _band(ax, time, estimated[:, axis], sigma[:, axis], "estimated ± σ")
        ax.plot(time, measured[:, axis], "k", linewidth=0.8, label="measured")
        _shade(ax, states, numpy.isnan(measured + estimated)[:, axis], fields[:2])
        ax.set(ylabel=f"{name}, mm")
    axes[0].set(title="Centre of pressure")
    axes[0].legend(loc="upper right", fontsize="small")
    axes[-1].set(xlabel="t, s")
    return figure


def gap(finding: Json) -> Figure:
    """The gap of `reconcile` per channel before and after the named effects, with the noise floor."""
    channels: Dict[str, Json] = finding["gap"]["per_axis"]
    units = sorted({channel["unit"] for channel in channels.values()}, reverse=True)
    figure, axes = _subplots(1, len(units))
    for ax, unit in zip(axes, units):
        shown = {name: channel for name, channel in channels.items() if channel["unit"] == unit}
        for at, key in enumerate(("before", "after", "noise_floor")):
            places = [place + 0.28 * (at - 1) for place in range(len(shown))]
            ax.bar(places, [channel[key] for channel in shown.values()], width=0.26, label=key.replace("_", " "))
        ax.set_xticks(range(len(shown)), list(shown), rotation=30)
        ax.set(ylabel=f"RMS of measured − predicted, {unit}")
    axes[0].legend(fontsize="small")
    effects = ", ".join(dict.fromkeys(effect["name"] for effect in finding["effects"]))
    figure.suptitle(f"Reconcile: {finding['verdict']}" + (f" ({effects})" if effects else ""))
    return figure


def _subplots(rows: int, columns: int = 1) -> Tuple[Figure, List[Axes]]:
    try:
        from matplotlib import pyplot
    except ImportError as cause:
        raise ImportError(f"plots need matplotlib: pip install 'equipoise[plot]' ({cause})") from cause
    figure, axes = pyplot.subplots(rows, columns, squeeze=False, sharex="col", layout="constrained")
    return figure, list(axes.flat)


def _band(ax: Axes, time: Array, value: Array, sigma: Array, label: str) -> None:
    (line,) = ax.plot(time, value, linewidth=1.2, label=label)
    ax.fill_between(time, value - sigma, value + sigma, color=line.get_color(), alpha=0.25, linewidth=0)


def _shade(ax: Axes, states: pandas.DataFrame, missing: Array, fields: Iterable[str]) -> None:
    """Shades the spans without a value: a row for each flag that invalidates one of the fields there."""
    import numpy

    raised = states["valid"].to_numpy(dtype="uint64")
    flags = (flag for flag in Reason if any(flag & INVALIDATED_BY[one] for one in fields))
    causes = {str(flag): missing & (raised & int(flag) != 0) for flag in flags}
    rows = {name: spans for name, spans in causes.items() if spans.any()}
    unexplained = missing & ~numpy.any([*rows.values(), numpy.zeros_like(missing)], axis=0)
    if unexplained.any():
        rows["unavailable"] = unexplained
    time, height = states.index.to_numpy(), 1 / max(len(rows), 1)
    for at, (name, spans) in enumerate(rows.items()):
        below, inside = at * height, ax.get_xaxis_transform()
        ax.fill_between(time, below, below + height, where=spans, transform=inside, color="0.5", alpha=0.3)
        ax.text(0.01, below + height / 2, name, transform=ax.transAxes, va="center", fontsize="small")
