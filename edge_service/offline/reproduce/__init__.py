"""The thesis' simulations, its puzzle and a real screw's wear, beside what was published."""
