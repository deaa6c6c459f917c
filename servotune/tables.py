"""Replies as tables of pandas and arrays of xarray, for whoever has these libraries. SI units; what does not exist is NaN."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

from servotune.optional import needed

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from servotune.replies.fits import Estimate, MeasuredCurves
    from servotune.replies.optimizations import GoalResult
    from servotune.replies.values import Metric

    Frame: TypeAlias = pd.DataFrame


def frame(index: str, unit: str, at: Sequence[float], columns: Mapping[Any, Sequence[Any]]) -> Frame:
    """Return curves over a common axis, whose name and unit are those of the index."""
    table = _made({name: _pandas().Series(values, dtype=float) for name, values in columns.items()})
    return table.set_axis(_pandas().Index(at, name=f"{index} ({unit})", dtype=float))


def stacked(variants: Sequence[Any], one: Callable[[Any], Frame]) -> Frame:
    """Return the table of the only variant, or those of all with the number of the variant as the first level of the index."""
    if len(variants) == 1:
        return one(variants[0])
    found: Frame = _pandas().concat(list(map(one, variants)), keys=range(len(variants)), names=["variant"])
    return found


def metrics_frame(metrics: Mapping[str, Mapping[str, Metric]]) -> Frame:
    """Return metrics, one to a row: output and metric, then value, unit, verdict."""
    rows = [
        {"output": output, "metric": name, "value": metric.value, "unit": metric.unit, "verdict": metric.verdict}
        for output, own in metrics.items()
        for name, metric in own.items()
    ]
    return _made(rows).astype({"value": float}).set_index(["output", "metric"])


def matrix(index: str, rows: Mapping[str, Mapping[str, float | None]]) -> Frame:
    """Return numbers by row and column."""
    return _made(rows).T.astype(float).rename_axis(index)


def estimates(parameters: Mapping[str, Estimate]) -> Frame:
    """Return estimated parameters, one to a row."""
    names = ("value", "unit", "lower95", "upper95", "start")
    table = _made({name: {key: own.get(name) for key, own in parameters.items()} for name in names})
    return table.rename_axis("parameter")


def goals(results: Sequence[GoalResult]) -> Frame:
    """Return goals before and after, one to a row."""
    rows = [
        {
            "metric": goal.metric, "output": goal.output, "before": goal.before.value, "after": goal.after.value,
            "unit": goal.after.unit, "met": goal.met,
        }
        for goal in results
    ]  # fmt: skip
    return _made(rows).astype({"before": float, "after": float})


def records(index: str, items: Sequence[Mapping[str, Any]]) -> Frame:
    """Return replies, one to a row; what is a table in itself gets a column for each of its names."""
    found: Frame = _pandas().json_normalize(list(items)).set_index(index)
    return found


def side_by_side(curves: Mapping[str, MeasuredCurves]) -> Frame:
    """Return measured and simulated values over time (s), with the output as the first level of the columns."""
    parts = {
        name: frame("time", "s", own.time, {"measured": own.measured, "simulated": own.simulated})
        for name, own in curves.items()
    }
    found: Frame = _pandas().concat(parts, axis=1)
    return found


def dataset(table: Frame, units: Mapping[str, str]) -> xr.Dataset:
    """Return a table as arrays with their units: its index, or the levels of it, are the dimensions."""
    plain: dict[str | int, str] = {str(name): str(name).partition(" (")[0] for name in table.index.names}
    axes = {plain[str(name)]: str(name).partition(" (")[2].rstrip(")") for name in table.index.names}
    found: xr.Dataset = needed("xarray", "to_xarray()").Dataset.from_dataframe(table.rename_axis(index=plain))
    for name, unit in {**axes, **units}.items():
        if unit:
            found[name].attrs["units"] = unit
    return found


def _pandas() -> Any:
    return needed("pandas", "this table")


def _made(content: Any) -> Frame:
    found: Frame = _pandas().DataFrame(content)
    return found
