"""Training of the pixel network on whole frames: for the depth and the force that its slopes sum up to."""
