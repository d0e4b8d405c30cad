"""Chances and random numbers, and the tables that scenarios read."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

Rng = np.random.Generator


def chance(rng: Rng, share: float) -> bool:
    return bool(rng.random() < share)


def log_uniform(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def rounded(rng: Rng, value: float) -> float:
    """Four digits, so that a scenario can be read; now and then all of them."""
    return float(value) if chance(rng, 0.1) else float(f"{value:.4g}")


def table_file(folder: Path, text: str) -> str:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder.resolve() / f"{hashlib.sha256(text.encode()).hexdigest()[:12]}.csv"
    path.write_text(text)
    return str(path)
