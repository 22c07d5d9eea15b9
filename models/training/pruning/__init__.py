"""Removal of what a trained network does not need: hidden neurons, and signed digits of its weights."""
