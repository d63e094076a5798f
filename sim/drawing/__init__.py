"""What every picture shares: the colours of classes, and the lines that are drawn."""
