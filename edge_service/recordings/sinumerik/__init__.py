"""Recordings of SINUMERIK controls: trace XML, Industrial Edge names, one axis of many."""
