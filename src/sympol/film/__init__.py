"""Films of episodes: the environment, and beside it the tree with the path of each observation highlighted."""
