"""A fit as files: the estimates, the values, and the scenario with the fitted numbers."""

from __future__ import annotations

import json
import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from simulator import __version__
from simulator.results.csv_text import Columns, write_csv
from simulator.results.extras import MissingExtra
from simulator.results.files import write_files
from simulator.results.plain_data import encoded

if TYPE_CHECKING:
    from simulator.results.fit import Fit
    from simulator.scenario import Scenario

FIT_RECORD, FIT_DETAILS, FITTED = "fit.json", "fit-record.json", "fitted.toml"
FIT_FILES = (FIT_RECORD, "fit.csv", FIT_DETAILS, FITTED)


def fit_record(fit: Fit) -> dict[str, Any]:
    """What `fit.json` holds: plain data, None for what the data do not say."""
    keys = [one.key for one in fit.estimates]
    record = {
        "estimates": {
            one.key: {
                "value": one.value,
                "unit": one.unit,
                "standard_error": one.standard_error,
                "low": one.low,
                "high": one.high,
            }
            for one in fit.estimates
        },
        "correlation": {
            key: dict(zip(keys, row, strict=True))
            for key, row in zip(keys, fit.correlation.tolist(), strict=True)
        },
        "reduced_chi2": fit.reduced_chi2,
        "converged": fit.converged,
    }
    found: dict[str, Any] = encoded(record)
    return found


def fit_details(fit: Fit) -> dict[str, Any]:
    """What `fit-record.json` holds: how the fit was made, and what else came out."""
    found: dict[str, Any] = encoded(
        {
            "fit": fit.file,
            "title": fit.title,
            "version": __version__,
            "message": fit.message,
            "values": fit.size,
            "degrees_of_freedom": fit.degrees,
            "aicc": fit.aicc,
            "loss": fit.loss,
            "confidence": fit.confidence,
            "intervals": fit.intervals,
            "starts": fit.starts,
            "played": fit.played,
            "at_bounds": fit.at_bounds,
            "undetermined": fit.undetermined,
            "beyond_their_branch": sum(int(column.beyond.sum()) for column in fit.columns),
        }
    )
    return found


def fit_columns(fit: Fit) -> Columns:
    """The measured values by column, in the order of `fit.csv`: one row for each value."""
    parts = fit.columns

    def words(text: list[str]) -> Any:
        sizes = [part.data.size for part in parts]
        return np.repeat(np.array([word.replace(",", ";") for word in text], dtype=object), sizes)

    return {
        "table": np.concatenate([np.full(part.data.size, part.table) for part in parts]),
        "row": np.concatenate([part.rows for part in parts]),
        "x_quantity": words([part.x_name for part in parts]),
        "x_unit": words([part.x_unit for part in parts]),
        "x": np.concatenate([part.x for part in parts]),
        "quantity": words([part.y_name for part in parts]),
        "unit": words([part.y_unit for part in parts]),
        "data": np.concatenate([part.data for part in parts]),
        "model": np.concatenate([part.model for part in parts]),
        "residual": np.concatenate([part.residual for part in parts]),
        "sigma": np.concatenate([part.sigma for part in parts]),
        "branch": np.concatenate([part.branch for part in parts]),
        "beyond": np.concatenate([part.beyond for part in parts]),
    }


def write_fit(fit: Fit, directory: str | os.PathLike[str]) -> list[Path]:
    """Write all files of a fit, see `Fit.to_csv`."""
    texts = [
        json.dumps(part, indent=2, ensure_ascii=False) + "\n" for part in (fit_record(fit), fit_details(fit))
    ]
    return write_files(
        directory,
        {
            FIT_RECORD: texts[0].encode(),
            "fit.csv": partial(write_csv, fit_columns(fit)),
            FIT_DETAILS: texts[1].encode(),
            FITTED: as_toml(fit.scenario, Path(directory)).encode(),
        },
    )


def as_toml(scenario: Scenario, folder: Path) -> str:
    """A scenario as a file in a folder has it; paths of tables start there. Raises MissingExtra."""
    try:
        import tomli_w
    except ImportError:
        raise MissingExtra("fitted.toml needs tomli-w: pip install 'dielectric-balloons[fit]'") from None
    text: str = tomli_w.dumps(_relative(scenario.to_dict(), folder))
    return text


def _relative(value: Any, folder: Path) -> Any:
    """A scenario's mapping with paths that start at a folder."""
    if isinstance(value, dict):
        return {
            key: os.path.relpath(item, folder)
            if key in ("table", "file") and isinstance(item, str) and os.path.isabs(item)
            else _relative(item, folder)
            for key, item in value.items()
        }
    return [_relative(item, folder) for item in value] if isinstance(value, list) else value
