"""What motions are made of: limits, segments, excitations, and the tests of an axis."""
