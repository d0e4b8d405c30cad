"""Fig. 5: an active balloon of half the radius; and the concluding remarks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tests.studies.paper.case import Case, Misprint, Statement, case_of
from tests.studies.paper.real import rising, snapping, switched_off

if TYPE_CHECKING:
    from simulator.results.history import Event

_AMBIENTS = (0.0, 0.05, 0.2, 1.0, 5.0, 20.0, 100.0)
_VOLTAGES = np.array([0.05, 0.1, 0.2, 0.4, 0.6])


def statements(cases: dict[str, Case]) -> list[Statement]:
    """Figs. 5b and c."""
    five_b = {letter: cases[f"5b {letter}"] for letter in "ABC"}
    five_c = {letter: cases[f"5c {letter}"] for letter in "ABC"}
    everywhere = {f"pₑ = {ambient:g}": _at(cases["5b B"], ambient) for ambient in _AMBIENTS}
    landings = [_landing(case.snaps[0]) for case in everywhere.values() if _lands(case)]
    states_c = {panel: cases[f"{panel} C"] for panel in ("3a", "3b", "3c", "5b", "5c")}
    last = [case.stretch_at(_VOLTAGES) for case in states_c.values()]
    spread = float(np.max(np.ptp(last, axis=0) / np.min(last, axis=0)))
    at = [f"{row[2]:.4f}" for row in last]
    inflations = [float(case.curve.pressure[0]) for case in five_b.values()]
    return [
        Statement(
            "Fig. 5",
            "states A, B, C are those of Fig. 2: P₀R₂/(μH) = 0.6, 1.2, 1.3",
            f"B is then our A (P₀R₂/(μH) = {inflations[0]:.4g}): at pₑ = 1 {_fate(five_b['A'])}, and switched off "
            "there is no state near 6",
            _lands(five_b["A"]),
            "0.6, 1.2, 1.3 are the active balloon's own load mP₀R₂/(μH): P₀R₂/(μH) = 1.2, 2.4, 2.6",
            np.allclose(0.5 * np.array(inflations), [0.6, 1.2, 1.3])
            and _lands(five_b["B"])
            and max(curve.stretch[0, 0] for curve in five_b["A"].curves) < 2.0,
        ),
        Statement(
            "Fig. 5",
            "a small active balloon near the edge of snap-through snaps to a stable large deformation, regardless of "
            "the ambient pressure",
            f"state B at pₑ = {', '.join(f'{a:g}' for a in _AMBIENTS)} lands on λ₁ = "
            f"{', '.join(f'{x:.3f}' for x in landings)}",
            len(landings) == len(_AMBIENTS) and min(landings) > 5.0,
            real=snapping(everywhere),
        ),
        Statement(
            "Fig. 5b",
            "only state B can snap through to a stable state",
            "; ".join(f"{letter}: {_fate(case)}" for letter, case in five_b.items()),
            [_lands(case) for case in five_b.values()] == [False, True, False],
            real=snapping(five_b),
        ),
        Statement(
            "Fig. 5c",
            "snap-through can be realised for states A or B",
            "; ".join(f"{letter}: {_fate(case)}" for letter, case in five_c.items()),
            [_lands(case) for case in five_c.values()] == [True, True, False],
            real=snapping(five_c),
        ),
        Statement(
            "Fig. 5",
            "the curves for state C change little",
            f"λ₁ = {', '.join(at)} at φ = 0.2 in 3a, 3b, 3c, 5b, 5c; {spread:.1%} apart at most, up to φ = 0.6",
            spread < 0.01,
            real=rising(states_c),
        ),
        *(_residual(f"{panel} B", cases) for panel in ("5b", "5c")),
    ]


def conclusions(cases: dict[str, Case]) -> list[Statement]:
    """Section 4."""
    fates = {name: _fate(cases[name]) for name in ("3a B", "3c B", "3c A", "5b A", "5b B", "5c A")}
    changed, discontinuous = ("3a B", "3c B", "3c A", "5b A", "5b B"), ("3c B", "5c A", "5b B")
    return [
        Statement(
            "Section 4",
            "radius ratio, environment pressure and inflation state affect the performance",
            f"changing one at a time from “{fates['3a B']}” (3a B): pₑ = 0.015: {fates['3c B']}; then P₀ = 0.6: "
            f"{fates['3c A']}; or m = 0.5: {fates['5b A']}; then P₀ = 2.4: {fates['5b B']}",
            len({fates[name] for name in changed}) == len(changed),
            real=snapping({name: cases[name] for name in changed}),
        ),
        Statement(
            "Section 4",
            "near vacuum, or near the verge of mechanical snap-through, the deformation may be discontinuous, and is "
            "physically achievable",
            f"near vacuum, 3c B: {fates['3c B']}, and 5c A: {fates['5c A']}; at pₑ = 1 at the verge, 5b B: {fates['5b B']}",
            all(_lands(cases[name]) for name in discontinuous),
            real=snapping({name: cases[name] for name in discontinuous}),
        ),
    ]


def misprints(cases: dict[str, Case]) -> list[Misprint]:
    """The labels of Fig. 5."""
    literal, read = cases["5b A"], cases["5b B"]
    residual = float(read.history.stretch[-1, 0])
    rests = sorted(float(curve.stretch[0, 0]) for curve in literal.curves)
    return [
        Misprint(
            "Fig. 5",
            "states A, B, C without new pressures, so P₀R₂/(μH) = 0.6, 1.2, 1.3 as in Fig. 2",
            "mP₀R₂/(μH) = 0.6, 1.2, 1.3",
            f"with P₀R₂/(μH) = 1.2 at pₑ = 1, {_fate(literal)}, and at zero voltage the only state has λ₁ = "
            f"{', '.join(f'{x:.4f}' for x in rests)}; with mP₀R₂/(μH) = 1.2, state B alone snaps to a stable state and "
            f"keeps λ₁ = {residual:.4f} when switched off, as the text says",
            not _lands(literal) and max(rests) < 2.0 and _lands(read) and round(residual) == 6,
        )
    ]


def _residual(name: str, cases: dict[str, Case]) -> Statement:
    case = cases[name]
    kept, start = float(case.history.stretch[-1, 0]), float(case.curve.stretch[0, 0])
    axis = [float(curve.stretch[0, 0]) for curve in case.curves[1:]]
    return Statement(
        f"Fig. {name.replace(' ', ', ')}",
        "switched off, the active balloon does not restore its inflated state but keeps a stretch ∼6, where the curve "
        "meets the axis",
        f"keeps λ₁ = {kept:.8f} (inflated: {start:.8f}); the detached branch meets φ = 0 at "
        f"{', '.join(f'{x:.8f}' for x in axis)}",
        round(kept) == 6 and case.history.voltage[-1, 0] == 0.0 and any(abs(kept - x) < 1e-9 for x in axis),
        real=switched_off({"": case}),
    )


def _at(case: Case, ambient: float) -> Case:
    """The same scenario at another ambient pressure."""
    gas = case.scenario.gas.model_copy(update={"ambient_pressure": ambient})
    return case_of(case.scenario.model_copy(update={"gas": gas}))


def _lands(case: Case) -> bool:
    """Whether the active balloon snaps up to a stable state."""
    return any(_landing(event) > event.stretch_before[0] for event in case.snaps)


def _landing(event: Event) -> float:
    """The active stretch at which a snap ends."""
    return float(event.stretch_before[0] if event.stretch_after is None else event.stretch_after[0])


def _fate(case: Case) -> str:
    """What the voltage does, in words."""
    if not case.actuated:
        return "no event"
    event = case.actuated[0]
    if case.snaps and event.stretch_after is not None:
        return f"snaps at φ = {event.voltage[0]:.8f} from λ₁ = {event.stretch_before[0]:.6f} to {event.stretch_after[0]:.6f}"
    if event.kind == "limit_point":
        return f"the snap at φ = {event.voltage[0]:.8f} (λ₁ = {event.stretch_before[0]:.6f}) loses tension"
    return f"tension is lost at φ = {event.voltage[0]:.8f}"
