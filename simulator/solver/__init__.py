"""Path following, polishing, snaps and real time, for any set of equations."""
