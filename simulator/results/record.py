"""How a run ended, in a few words; and `run.json`, with what it cost and which software did it."""

from __future__ import annotations

import math
import platform
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, fields
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from simulator.events import Outcome
from simulator.results.plain_data import encoded
from simulator.results.summary import summary_record

if TYPE_CHECKING:
    from simulator.results.history import History


def ending(history: History) -> str:
    """How a history ended, in a few words."""
    if not len(history):
        return "nothing was computed"
    time = f"time {history.time[-1]:.6g}{' s' if history.scenario.scales else ''}"
    match history.outcome:
        case Outcome.COMPLETED:
            return f"completed at {time}"
        case Outcome.FAILED:
            return f"partial: the solver failed after {time}"
    return f"ended by {history.outcome.value.replace('_', ' ')} at {time}"


def run_record(history: History, failure: str | None = None) -> dict[str, Any]:
    """What `run.json` says: the scenario, how its run ended, what it cost and which software did it.

    Parameters
    ----------
    history : History
    failure : str, optional
        Message of the solver failure that ended the run early.

    Returns
    -------
    dict
        Plain values that strict JSON can carry; a number that is not finite is None.
    """
    import sksundae

    scenario = history.scenario
    balance = history.energy_balance
    record = {
        "title": scenario.title,
        "source": scenario.source,
        "outcome": history.outcome.value,
        "partial": history.outcome is Outcome.FAILED,
        "failure": failure,
        "counts": {
            "samples": len(history),
            "steps": int(history.step[-1]) if len(history) else 0,
            "branches": int(history.branch[-1]) + 1 if len(history) else 0,
            "events": len(history.events),
            "events_by_kind": dict(Counter(event.kind.value for event in history.events)),
        },
        "summary": summary_record(history),
        **({"until": [asdict(stop) for stop in history.stops]} if history.stops else {}),
        **({"films": [asdict(verdict) for verdict in history.verdicts]} if history.rated else {}),
        **({"shapes": [verdict.record() for verdict in history.shapes]} if history.sphericity.size else {}),
        "elastomers": history.elastomers,
        "energy_balance": {**asdict(balance), "relative_imbalance": balance.relative_imbalance},
        "statistics": asdict(history.statistics),
        "result": _rest(history),
        "scenario": scenario.to_dict(),
        **({"scales": scenario.scales.record()} if scenario.scales else {}),
        "versions": {
            "dielectric-balloons": _own_version(),
            "python": platform.python_version(),
            "numpy": np.__version__,
            "pandas": version("pandas"),
            "scikit-sundae": version("scikit-sundae"),
            "SUNDIALS": str(sksundae.SUNDIALS_VERSION),
        },
    }
    content: dict[str, Any] = plain(record)
    return content


def _rest(history: History) -> dict[str, Any]:
    """What `load_history` needs besides the tables: all that is no array and no event."""
    tables = ("scenario", "balloons", "electroded", "events")
    values = {field.name: getattr(history, field.name) for field in fields(history)}
    return {n: encoded(v) for n, v in values.items() if n not in tables and not isinstance(v, np.ndarray)}


def plain(value: Any) -> Any:
    """The same value in types that strict JSON knows; None for NaN and infinities, which it does not."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int):
        return value
    return str(value)


def _own_version() -> str:
    from simulator import __version__

    return __version__
