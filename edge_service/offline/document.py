"""Base of the documents with which commands answer programs."""

from ..messages.interval import Frozen


class Document(Frozen):
    """Base of the documents: units stand in the names, what is not known is null."""
