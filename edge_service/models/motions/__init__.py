"""Building blocks of motions: limits, segments, excitations, and the tests of an axis."""
