"""References that know the physics and nothing of the solver that is held against them."""
