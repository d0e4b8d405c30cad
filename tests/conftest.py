"""Settings of all tests."""

import os

from hypothesis import settings

# Examples that write files take as long as the disk does. What is checked before a change goes in
# must not depend on luck.
settings.register_profile("balloons", deadline=None, derandomize="CI" in os.environ)
settings.load_profile("balloons")
