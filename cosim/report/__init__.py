"""Pages: one HTML file a report, nothing fetched; one module a kind of result."""
