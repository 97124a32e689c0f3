"""Results on disk and in numbers: files, summary, provenance."""
