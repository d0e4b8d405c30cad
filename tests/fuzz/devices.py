"""Random devices: gas, balloons, films, elastomers, and how long they take to move."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.chances import Rng, chance, log_uniform, rounded, table_file
from tests.oracle.general.elastomers import gent, ogden

Document = dict[str, Any]


def scales(rng: Rng) -> Document:
    return {
        "shear_modulus": f"{rounded(rng, rng.uniform(10.0, 500.0))!r} kPa",
        "thickness": f"{rounded(rng, rng.uniform(0.1, 2.0))!r} mm",
        "radius": f"{rounded(rng, rng.uniform(5.0, 50.0))!r} mm",
        "permittivity": rounded(rng, rng.uniform(2.5, 8.0)) if chance(rng, 0.7) else "41.6 pF/m",
    }


def gas(rng: Rng, wild: bool) -> Document:
    if chance(rng, 0.25):
        ambient = 0.0
    else:
        ambient = log_uniform(rng, 1e-3, 300.0) if wild else log_uniform(rng, 0.01, 5.0)
    gas: Document = {"ambient_pressure": rounded(rng, ambient)}
    if chance(rng, 0.3):
        gas["chamber"] = rounded(rng, log_uniform(rng, 1e-3, 300.0 if wild else 10.0))
    law = rng.choice(["", "isothermal", "adiabatic", "liquid"], p=[0.5, 0.1, 0.22, 0.18])
    if law:
        gas["law"] = str(law)
    if law == "adiabatic" and chance(rng, 0.5):
        gas["exponent"] = rounded(rng, rng.uniform(1.05, 1.67))
    return gas


def balloons(rng: Rng, wild: bool, folder: Path) -> list[Document]:
    count = int(rng.choice([1, 2, 3, 4, 5, 6], p=[0.25, 0.35, 0.2, 0.1, 0.06, 0.04]))
    names = [f"b{i}" for i in range(count)]
    if chance(rng, 0.12) and count > 1:  # all of one make
        model = _balloon(rng, wild, folder)
        balloons = [{"name": name, **copy.deepcopy(model)} for name in names]
    else:
        balloons = [{"name": name, **_balloon(rng, wild, folder)} for name in names]
        if chance(rng, 0.4):  # all of one film
            for balloon in balloons[1:]:
                balloon["elastomer"] = dict(balloons[0]["elastomer"])
    if not any(b.get("electrodes") for b in balloons) and chance(rng, 0.95):
        balloons[int(rng.integers(count))]["electrodes"] = True
    for balloon in balloons:
        if balloon.get("electrodes") and chance(rng, 0.25):
            balloon["breakdown"] = _breakdown(rng, balloon)
    return balloons


def _balloon(rng: Rng, wild: bool, folder: Path) -> Document:
    balloon: Document = {}
    spread = {"radius": 20.0 if wild else 2.0, "thickness": 3.0 if wild else 2.0, "modulus": 3.0}
    for key, most in {**spread, "permittivity": 2.0}.items():
        if chance(rng, 0.5 if key == "radius" else 0.25):
            balloon[key] = rounded(rng, log_uniform(rng, 1.0 / most, most))
    if chance(rng, 0.6):
        balloon["electrodes"] = True
    elif chance(rng, 0.1):
        balloon["electrodes"] = False
    balloon["elastomer"] = _elastomer(rng, wild, folder)
    return balloon


def _breakdown(rng: Rng, balloon: Document) -> Document:
    # Fields at limit points are about 1 in this unit, fields after a snap about 10.
    unit = np.sqrt(balloon.get("modulus", 1.0) / balloon.get("permittivity", 1.0))
    field = rounded(rng, unit * log_uniform(rng, 0.3, 30.0))
    if chance(rng, 0.6):
        return {"field": field, **({"law": "constant"} if chance(rng, 0.1) else {})}
    exponents = {"stretch_exponent": rng.uniform(-1.0, 1.5), "thickness_exponent": rng.uniform(-0.5, 0.3)}
    return {"law": "power", "field": field, **{k: rounded(rng, float(v)) for k, v in exponents.items()}}


def _elastomer(rng: Rng, wild: bool, folder: Path) -> Document:
    chances = {
        "gent": 0.4,
        "neo-hookean": 0.06,
        "mooney-rivlin": 0.08,
        "ogden": 0.12,
        "arruda-boyce": 0.1,
        "yeoh": 0.03,
        "gent-gent": 0.03,
        "fung": 0.03,
        "tabulated": 0.08,
        "preset": 0.07,
    }
    model = rng.choice(list(chances), p=list(chances.values()))
    match str(model):
        case "gent":
            return {"model": "gent", "J_lim": _j_lim(rng, wild)}
        case "neo-hookean":
            return {"model": "neo-hookean"}
        case "mooney-rivlin":
            return {
                "model": "mooney-rivlin",
                "C1": rounded(rng, rng.uniform(0.5, 2.0)),
                "C2": 0.0 if chance(rng, 0.1) else rounded(rng, log_uniform(rng, 0.01, 0.6)),
            }
        case "ogden":
            return _ogden(rng)
        case "arruda-boyce":
            return {
                "model": "arruda-boyce",
                "lambda_L": rounded(rng, log_uniform(rng, 1.3, 15.0) if wild else rng.uniform(2.5, 8.0)),
            }
        case "yeoh":
            C1, C2 = rounded(rng, log_uniform(rng, 0.1, 10.0)), float(rng.uniform(-0.03, 0.05))
            return {
                "model": "yeoh",
                "C1": C1,
                "C2": rounded(rng, C1 * C2),
                "C3": rounded(rng, C1 * log_uniform(rng, 1e-4, 1e-2)),
            }
        case "gent-gent":
            C2 = rounded(rng, log_uniform(rng, 0.01, 3.0))
            return {"model": "gent-gent", "C1": 1.0, "C2": C2, "J_lim": _j_lim(rng, wild)}
        case "fung":
            return {"model": "fung", "b": rounded(rng, log_uniform(rng, 0.003, 0.3))}
        case "tabulated":
            return {"model": "tabulated", "table": _measured(rng, folder)}
        case _:
            return {"preset": str(rng.choice(["VHB-4910", "Sylgard-186", "natural-rubber"]))}


def _j_lim(rng: Rng, wild: bool) -> float:
    if chance(rng, 0.3):
        return 100.0
    return rounded(rng, log_uniform(rng, 5.0, 1000.0) if wild else log_uniform(rng, 20.0, 300.0))


def _ogden(rng: Rng) -> Document:
    """Terms with μα > 0; one in four has a small one of the other sign as well, as some fits do."""
    if chance(rng, 0.2):
        return {"model": "ogden", "mu": [6.3e5, 1.2e3, -1e4], "alpha": [1.3, 5.0, -2.0]}
    alpha = [rounded(rng, float(rng.uniform(0.8, 3.0)))]
    mu = [rounded(rng, float(rng.uniform(0.5, 3.0)))]
    if chance(rng, 0.7):
        alpha.append(rounded(rng, -float(rng.uniform(0.5, 3.0))))
        mu.append(rounded(rng, -log_uniform(rng, 0.005, 0.3)))
    if chance(rng, 0.5):
        alpha.append(rounded(rng, float(rng.uniform(4.0, 7.0))))
        mu.append(rounded(rng, log_uniform(rng, 1e-4, 0.02)))
    if chance(rng, 0.25):
        alpha.append(rounded(rng, float(rng.uniform(0.5, 2.0))))
        mu.append(rounded(rng, -0.1 * mu[0] * rng.random()))
    return {"model": "ogden", "mu": mu, "alpha": alpha}


def _measured(rng: Rng, folder: Path) -> str:
    """A measured curve: the rows of a smooth law, at smoothly spaced stretches, of many or few digits."""
    if chance(rng, 0.7):
        law = gent(float(rng.uniform(20.0, 200.0)))
    else:
        law = ogden((1.49, 0.003, -0.024), (1.3, 5.0, -2.0))
    last = float(rng.uniform(2.0, 0.8 * min(law.limit, 8.0)))
    spread = np.linspace(0.0, 1.0, int(rng.integers(14, 40))) ** rng.uniform(1.0, 1.5)
    stretches = np.round(1.0 + (last - 1.0) * spread, 4)
    kind = str(rng.choice(["stress", "pressure"]))
    forces = np.array([law.force(x) for x in stretches.tolist()])
    values = np.round(forces / (2.0 if kind == "stress" else stretches**2), int(rng.choice([7, 10])))
    rows = [f"{x!r},{y!r}" for x, y in zip(stretches.tolist(), values.tolist(), strict=True)]
    return table_file(folder, "\n".join([f"stretch,{kind}", *rows]) + "\n")


def dynamics(rng: Rng, balloons: list[Document], pace: float) -> Document:
    def relaxation() -> float:
        return rounded(
            rng, pace * (log_uniform(rng, 1e-2, 10.0) if chance(rng, 0.8) else log_uniform(rng, 1e-5, 1e3))
        )

    if chance(rng, 0.35):
        for balloon in balloons:
            if chance(rng, 0.7):
                balloon["maxwell"] = _branches(rng, part(balloon, "modulus"), pace)
    key = "viscosity" if chance(rng, 0.2) else "relaxation_time"
    if chance(rng, 0.3):
        return {key: {b["name"]: relaxation() for b in balloons}}
    return {key: relaxation()}


def supply(rng: Rng, balloons: list[Document], pace: float) -> Document | None:
    """What is between the sources and the films, and how the films leak; mostly nothing."""
    films = [balloon for balloon in balloons if balloon.get("electrodes")]
    if not films or not chance(rng, 0.3):
        return None

    def resistance(balloon: Document) -> float:
        size = part(balloon, "radius") ** 2 * part(balloon, "permittivity") / part(balloon, "thickness")
        return rounded(rng, pace * log_uniform(rng, 1e-4, 10.0) / size)

    for balloon in films:
        if chance(rng, 0.4):
            balloon["leak"] = {
                "conductivity": rounded(
                    rng, part(balloon, "permittivity") * log_uniform(rng, 1e-3, 1.0) / pace
                )
            }
            if chance(rng, 0.5):
                unit = float(np.sqrt(part(balloon, "modulus") / part(balloon, "permittivity")))
                balloon["leak"]["field"] = rounded(rng, unit * log_uniform(rng, 0.5, 10.0))
    found: Document = {"resistance": resistance(films[0])}
    if chance(rng, 0.3):
        found["resistance"] = {balloon["name"]: resistance(balloon) for balloon in films}
    if chance(rng, 0.3):
        found["current_limit"] = rounded(rng, voltage_unit(films[0]) / resistance(films[0]))
    return found


def _branches(rng: Rng, stiffness: float, pace: float) -> Document | list[Document]:
    """One viscoelastic branch, or a list of one to three."""

    def branch() -> Document:
        modulus = rounded(rng, stiffness * log_uniform(rng, 0.05, 4.0))
        return {"modulus": modulus, "time": rounded(rng, pace * log_uniform(rng, 0.03, 30.0))}

    first = branch()
    if chance(rng, 0.4):
        return first | ({"flow": "linear"} if chance(rng, 0.3) else {})
    several = [first, *(branch() for _ in range(int(rng.integers(0, 3))))]
    return [one | ({"flow": "newtonian"} if chance(rng, 0.2) else {}) for one in several]


def part(balloon: Document, key: str) -> float:
    return float(balloon.get(key, 1.0))


def voltage_unit(balloon: Document) -> float:
    """The voltage h√(k/e) in which a film's limit points are of order 1."""
    return part(balloon, "thickness") * float(
        np.sqrt(part(balloon, "modulus") / part(balloon, "permittivity"))
    )
