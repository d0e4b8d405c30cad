"""The page in a notebook: `explore`."""

from __future__ import annotations

import asyncio
import sys
import threading
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from simulator.live import MISSING, worker
from simulator.results.extras import MissingExtra
from simulator.results.history import History
from simulator.simulation.replay import Replay

try:
    import panel as pn
    from panel.io.notebook import block_comm

    from simulator.live.page import Page
except ImportError as error:
    raise MissingExtra(MISSING) from error

if TYPE_CHECKING:
    from simulator.scenario import Scenario


class Explorer:
    """A scenario whose numbers are moved in a notebook, as returned by `explore`; elsewhere its history.

    Attributes
    ----------
    scenario : Scenario
        As its numbers are now.
    history : History or None
        What is shown; None where nothing could be played.
    view : panel.Column
        What is shown, to be made a part of something larger with Panel.

    Examples
    --------
    >>> from simulator import explore, load_scenario
    >>> view = explore(load_scenario("scenarios/fig3c_state_b.toml"))
    >>> view.scenario.title
    'Fig. 3c, state B: a snap and its way back'
    """

    def __init__(self, scenario: Scenario) -> None:
        self._waiting: deque[Callable[[], None]] = deque()
        self._turn = threading.Lock()
        self._is_shown = False
        try:
            self._loop: Any = asyncio.get_running_loop()  # a kernel's
        except RuntimeError:
            self._loop = None
        with self._turn:
            self._page = Page(scenario, scenario, Here(), self._post, in_page=False)
        self._work()

    @property
    def scenario(self) -> Scenario:
        return self._page.scenario

    @property
    def history(self) -> History | None:
        return self._page.shown.history if self._page.shown else None

    @property
    def view(self) -> Any:
        return self._page.view

    def _repr_html_(self) -> str:
        return self.history._repr_html_() if self.history else ""

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> Any:
        if in_kernel():
            self._is_shown = True
            return self.view._repr_mimebundle_(include, exclude)
        return {"text/html": self._repr_html_()}

    def _post(self, function: Callable[[], None]) -> None:
        """Call a function when no other one changes the view."""
        self._waiting.append(function)
        if self._loop:
            self._loop.call_soon_threadsafe(self._work)
        else:
            self._work()

    def _work(self) -> None:
        while self._waiting and self._turn.acquire(blocking=False):
            try:
                # A newer kernel hears the browser in a thread of its own, where Panel sends at once whatever
                # has changed by then; of two messages sent at a time the browser can read none.
                with block_comm():
                    while self._waiting:
                        self._waiting.popleft()()
            finally:
                if self._is_shown:  # what came before is part of it
                    pn.io.push_notebook(self.view)
                self._turn.release()


class Here:
    """Computes in this process, so that elastomers of your own take part; like a `Worker`."""

    def __init__(self) -> None:
        self._turn, self._replay = threading.Lock(), Replay()

    def __call__(self, function: Callable[..., Any], argument: Any) -> worker.Answer:
        with self._turn:
            return worker.answered(function, argument, self._replay)


def in_kernel() -> bool:
    """Whether this is a notebook that can be answered to."""
    shell = sys.modules.get("IPython")  # there already where it runs
    return getattr(shell and shell.get_ipython(), "kernel", None) is not None


def explore(what: Scenario | History) -> Explorer:
    """The page of `balloons live` as an object that a notebook shows.

    Needs the extra ``live``, else MissingExtra is raised.

    Examples
    --------
    >>> from simulator import load_scenario
    >>> view = load_scenario("scenarios/fig3c_state_b.toml").live()
    >>> view.history.outcome.value
    'completed'
    """
    if in_kernel():
        pn.extension(inline=True)  # nothing is asked for from elsewhere
    return Explorer(what.scenario if isinstance(what, History) else what)
