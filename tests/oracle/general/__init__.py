"""The reference for the whole grammar of scenarios.

>>> from tests.oracle.general import play
>>> reference = play("scenarios/fig3c_state_b.toml")
>>> reference.outcome, [event.kind for event in reference.events], reference.undecided

It shares nothing with the simulator but scenario files. `play` is for quasi-static scenarios, `real_time` for
those with [dynamics].
"""

from __future__ import annotations

from tests.oracle.general.device import Device
from tests.oracle.general.history import play
from tests.oracle.general.record import Reference, ReferenceEvent, State

__all__ = ["Device", "Reference", "ReferenceEvent", "State", "play"]
