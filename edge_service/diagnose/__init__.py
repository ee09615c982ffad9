"""The sim-to-real gap: where the model and the machine disagree, why, and how far it shrinks."""
