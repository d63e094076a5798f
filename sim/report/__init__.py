"""A sweep summed up: intervals, comparisons on equal seeds, tables, pictures and a page."""
