"""One run: steps, events, samples and energy books."""
