"""What the commands write and print."""
