"""Settings, wiring, the folder of a campaign and `Campaign`: what every door calls."""
