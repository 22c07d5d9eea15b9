"""The step engine: steps, the store of their results, and traces that tell whether one is current."""
