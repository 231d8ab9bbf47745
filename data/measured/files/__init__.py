"""Measured records as their loggers wrote them: one reader per file format, one table out."""
