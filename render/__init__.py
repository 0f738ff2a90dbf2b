"""The shipped pictures: roads and chessboards path-traced by Mitsuba 3, with exact ground truth (see README.md)."""
