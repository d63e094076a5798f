"""Pictures with matplotlib: of a plan, and those of the paper made anew."""
