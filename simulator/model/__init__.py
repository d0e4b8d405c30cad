"""The device as equations: elastomers, membranes, contents, strengths, and what can end a branch."""
