"""Recordings in and out: CSV, Parquet, SINUMERIK trace XML, MCAP; streamed in bounded memory."""
