"""Answers in an OPC UA server: condition, preload and prognosis in the words of its companions."""
