"""The leaderboard of free runs."""
