"""Fig. 3: equal balloons at three ambient pressures."""

from __future__ import annotations

import numpy as np

from simulator.model.device import Device
from tests.studies.paper.case import Case, Statement, falls, rises
from tests.studies.paper.real import UNREALISABLE, rising, snapping, switched_off, whole


def statements(cases: dict[str, Case]) -> list[Statement]:
    """Figs. 3a, b and c."""
    return [*_panel_a(cases), *_panel_b(cases), *_panel_c(cases)]


def _panel_a(cases: dict[str, Case]) -> list[Statement]:
    found = []
    for letter in "ABC":
        curve = cases[f"3a {letter}"].curve
        found.append(rises(curve.stretch[:, 0]) and rises(curve.voltage[:, 0]) and falls(curve.pressure))
    first = Statement(
        "Fig. 3a",
        "the stretch of the active balloon increases with the voltage, the pressure decreases",
        f"so along the whole paths of {sum(found)} of 3 states",
        all(found),
        real=rising({letter: cases[f"3a {letter}"] for letter in "ABC"}),
    )
    ends = []
    for letter in "AB":
        case = cases[f"3a {letter}"]
        end, (event, *_) = case.curve.end, case.actuated
        ends.append(
            Statement(
                f"Fig. 3a, {letter}",
                "goes up monotonically until tension is lost, where the pressure vanishes",
                f"no limit point; p = 0 at φ = {end.voltage[0]:.8f}, λ₁ = {end.stretch[0]:.8f}; the history ends there",
                case.peak is None
                and end.kind == "loss_of_tension"
                and abs(end.pressure) < 1e-12
                and case.loses_tension
                and bool(abs(event.voltage[0] - end.voltage[0]) < 1e-9),
                real=rising({"": case}),
            )
        )
    case = cases["3a C"]
    limit = Device.from_scenario(case.scenario).elastomers[0].stretch_limit
    ramped = float(case.history.stretch[case.history.voltage[:, 0].argmax(), 0])
    shares = case.stretch_at(np.array([0.2, 0.4, 1.0]))
    fields = [float(cases[f"3a {letter}"].curve.field.max()) for letter in "AB"]
    field = float(case.history.field.max())
    return [
        first,
        *ends,
        Statement(
            "Fig. 3a, C",
            "a very steep curve on which the stretch approaches the limit of approximately seven",
            f"λ₁ = {', '.join(f'{x:.4f}' for x in shares)} at φ = 0.2, 0.4, 1 (φ = 0.2: {ramped:.8f}); "
            f"the limit is {limit:.4f}",
            case.curve.end.kind == "stretch_limit" and round(limit) == 7,
            real=rising({"": case}),
        ),
        Statement(
            "Fig. 3a, C",
            "loss of tension is not an issue",
            f"the pressure stays above {case.curve.pressure.min():.4f}",
            bool(case.curve.pressure.min() > 0.5),
            real=rising({"": case}),
        ),
        Statement(
            "Fig. 3a, C",
            "it would fail by electrical breakdown",
            f"true field {field:.2f} at φ = 0.2, and it grows without bound ({case.curve.field.max():.0f} within "
            f"1e-6 of the limit); A and B lose tension at {fields[0]:.2f} and {fields[1]:.2f}",
            False,
            "the strength, for which the paper has no number, is above the fields of A and B and is reached by C",
            field > 2.0 * max(fields) and rises(case.curve.field[:, 0]),
            rising({"": case}),
        ),
    ]


def _panel_b(cases: dict[str, Case]) -> list[Statement]:
    found = []
    for letter in "AB":
        case = cases[f"3b {letter}"]
        peak, end = case.peak, case.curve.end
        if peak is None:
            raise ArithmeticError(f"Fig. 3b, {letter}: no limit point")
        voltage, after = case.curve.voltage[:, 0], case.curve.unstable[case.rising :]
        found += [
            Statement(
                f"Fig. 3b, {letter}",
                "firstly goes up, reaches a peak (EMI), and then goes down, to where tension is lost",
                f"peak at φ = {peak.voltage[0]:.8f}, λ₁ = {peak.stretch[0]:.8f}; "
                f"p = 0 at φ = {end.voltage[0]:.8f}, λ₁ = {end.stretch[0]:.8f}",
                rises(voltage[: case.rising])
                and falls(voltage[case.rising - 1 :])
                and end.kind == "loss_of_tension",
                real=whole({"": case}),
            ),
            Statement(
                f"Fig. 3b, {letter}",
                "ramping up is limited by EMI and can not reach loss of tension",
                f"the stable branch ends at the peak, with p = {peak.pressure:.4f}; but the snap from there finds no "
                "state to rest in, and loses tension itself",
                not case.loses_tension,
                "of states of equilibrium",
                case.loses_tension
                and bool(peak.pressure > 0.0 and (case.curve.unstable[: case.rising] == 0).all()),
                snapping({"": case}),
            ),
            Statement(
                f"Fig. 3b, {letter}",
                "loss of tension can only be reached if the voltage is at some point decreased again",
                f"it is {peak.voltage[0] - end.voltage[0]:.4f} below the peak, but all states between are unstable",
                bool((after == 0).all() and end.voltage[0] < peak.voltage[0]),
                "of the curve, followed beyond its peak through unstable states",
                bool((after > 0).all() and end.voltage[0] < peak.voltage[0]),
                whole({"": case}),
            ),
        ]
    case = cases["3b C"]
    return [*found, _without_event("Fig. 3b, C", case)]


def _panel_c(cases: dict[str, Case]) -> list[Statement]:
    blue, red = cases["3c A"], cases["3c B"]
    peak, top = blue.peak, red.peak
    if peak is None or top is None or not red.snaps or red.snaps[0].stretch_after is None:
        raise ArithmeticError("Fig. 3c: a limit point or a snap is missing")
    snap, after = red.snaps[0], red.snaps[0].stretch_after
    end, blue_end = red.curve.end, blue.curve.end
    beyond = (red.curve.stretch[:, 0] >= after[0] - 1e-3) & (
        red.curve.voltage[:, 0] >= snap.voltage[0] - 1e-6
    )
    return [
        Statement(
            "Fig. 3c, A",
            "limited by EMI; snaps to an unstable state and eventually ruptures or breaks down",
            f"limit point at φ = {peak.voltage[0]:.8f}, λ₁ = {peak.stretch[0]:.8f}; the snap loses tension",
            bool(blue.snaps),
            "the snap finds no stable state at all",
            blue.loses_tension and len(blue.actuated) == 2,
            snapping({"": blue}),
        ),
        Statement(
            "Fig. 3c, A",
            "the path from EMI to loss of tension is unstable and can not be realised",
            f"unstable all the way to p = 0 at φ = {blue_end.voltage[0]:.8f}, λ₁ = {blue_end.stretch[0]:.8f}",
            bool((blue.curve.unstable[blue.rising :] > 0).all()) and blue_end.kind == "loss_of_tension",
            real=UNREALISABLE,
        ),
        Statement(
            "Fig. 3c, B",
            "reaches EMI and snaps to a stable state",
            f"limit point at φ = {top.voltage[0]:.8f}, λ₁ = {top.stretch[0]:.8f}; rests at λ₁ = {after[0]:.8f}",
            bool(abs(snap.voltage[0] - top.voltage[0]) < 1e-9 and after[0] > 2.0 * top.stretch[0]),
            real=snapping({"": red}),
        ),
        Statement(
            "Fig. 3c, B",
            "and then continues to deform before tension is lost",
            f"stable from there up to p = 0 at φ = {end.voltage[0]:.8f}, λ₁ = {end.stretch[0]:.8f}",
            end.kind == "loss_of_tension"
            and bool(end.voltage[0] > snap.voltage[0])
            and bool((red.curve.unstable[beyond] == 0).all()),
            real=snapping({"": red}),
        ),
        _without_event("Fig. 3c, C", cases["3c C"]),
    ]


def _without_event(place: str, case: Case) -> Statement:
    ramped = float(case.history.stretch[case.history.voltage[:, 0].argmax(), 0])
    return Statement(
        place,
        "(as drawn) one rising curve",
        f"no limit point, no loss of tension; λ₁ = {ramped:.8f} at φ = 0.2, and the inflated state again at 0",
        case.peak is None
        and case.curve.end.kind == "stretch_limit"
        and not case.actuated
        and bool(np.abs(case.history.stretch[-1] - case.curve.stretch[0]).max() < 1e-9),
        real=switched_off({"": case}),
    )
