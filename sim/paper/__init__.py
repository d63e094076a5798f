"""The figures of the paper, made anew, and one more: the share of each class against the noise."""
