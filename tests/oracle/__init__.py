"""References that the simulator is measured against; none of them is part of the package."""
