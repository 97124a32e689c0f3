"""FMUs and the wired system for other tools: SSP, container FMU."""
