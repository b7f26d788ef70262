"""What is measured: a function for each part."""
