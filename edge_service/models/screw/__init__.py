"""The ball screw: geometry, preload and drag, friction, stiffness, wear."""
