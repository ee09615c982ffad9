"""The simulated feed drive: two masses, friction that sticks, cascade, encoders."""
