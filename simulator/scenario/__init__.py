"""What the user wrote: a scenario file, validated and frozen. No physics happens here.

`load_scenario` reads the grammar of `docs/scenario-format.md` and either returns a `Scenario` or raises one
`ScenarioError` that lists every problem in the words of the file. Each field says
in its `description` what it allows; the messages are made from these, so the two cannot drift apart.
"""

from simulator.scenario.checks import MAX_SAMPLES
from simulator.scenario.device import (
    Balloon,
    Breakdown,
    ConstantBreakdown,
    Gas,
    Leak,
    Maxwell,
    MaxwellPreset,
    PowerBreakdown,
)
from simulator.scenario.dimensions import dimension_of, dimensionless
from simulator.scenario.document import Scenario, ScenarioLike, load_scenario
from simulator.scenario.elastomer import (
    ArrudaBoyce,
    Elastomer,
    Fung,
    Gent,
    GentGent,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Preset,
    Python,
    Tabulated,
    Yeoh,
)
from simulator.scenario.errors import Problem, ScenarioError
from simulator.scenario.presets import PRESETS
from simulator.scenario.recordings import Recording, RecordingByName
from simulator.scenario.scales import Reference
from simulator.scenario.settings import Dynamics, Output, Shape, Solver, Supply
from simulator.scenario.steps import (
    BalloonSine,
    BalloonTriangle,
    Charge,
    Cycle,
    Hold,
    Inflate,
    Jump,
    PlayedStep,
    Ramp,
    Sine,
    SineByName,
    SineWave,
    Step,
    Table,
    Triangle,
    TriangleByName,
    TriangleWave,
    Until,
    duration,
    until_of,
)

__all__ = [
    "MAX_SAMPLES",
    "PRESETS",
    "ArrudaBoyce",
    "Balloon",
    "BalloonSine",
    "BalloonTriangle",
    "Breakdown",
    "Charge",
    "ConstantBreakdown",
    "Cycle",
    "Dynamics",
    "Elastomer",
    "Fung",
    "Gas",
    "Gent",
    "GentGent",
    "Hold",
    "Inflate",
    "Jump",
    "Leak",
    "Maxwell",
    "MaxwellPreset",
    "MooneyRivlin",
    "NeoHookean",
    "Ogden",
    "Output",
    "PlayedStep",
    "PowerBreakdown",
    "Preset",
    "Problem",
    "Python",
    "Ramp",
    "Recording",
    "RecordingByName",
    "Reference",
    "Scenario",
    "ScenarioError",
    "ScenarioLike",
    "Shape",
    "Sine",
    "SineByName",
    "SineWave",
    "Solver",
    "Step",
    "Supply",
    "Table",
    "Tabulated",
    "Triangle",
    "TriangleByName",
    "TriangleWave",
    "Until",
    "Yeoh",
    "dimension_of",
    "dimensionless",
    "duration",
    "load_scenario",
    "until_of",
]
