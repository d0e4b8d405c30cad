"""The page of Fig. 5b, state B, on which the solver fails behind step 2 unless the ambient pressure is 1."""

from __future__ import annotations

from typing import Any

from simulator import load_scenario, simulate
from simulator.live import server, worker


class Failing:
    """Computes like a `Worker`."""

    def __call__(self, function: Any, argument: Any, limit: float = 0.0) -> worker.Answer:
        if function is worker.play and argument.gas.ambient_pressure != 1.0:
            document = argument.to_dict()
            reached = simulate({**document, "step": document["step"][:2]})
            return worker.Answer((reached, "step 3, time 11: <b>no point</b> was found"))
        return worker.Answer(function(argument))


if __name__ == "__main__":
    worker.Worker = Failing  # type: ignore[assignment,misc]
    opened = load_scenario("scenarios/fig5b_state_b.toml")
    server.serve(opened, host="127.0.0.1", port=0, show=False)
