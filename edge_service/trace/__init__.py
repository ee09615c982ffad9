"""Recordings in and out: CSV and Parquet, streamed in bounded memory."""
