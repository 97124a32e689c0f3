"""The master algorithm: instances started, a schedule executed, rows recorded, how it ended."""
