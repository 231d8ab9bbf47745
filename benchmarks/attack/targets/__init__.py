"""What is attacked: a file for each way in. Each has a class `Target`, see attempt.py."""
