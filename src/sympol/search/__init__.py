"""Better trees out of trees, by playing: smaller ones, stronger ones, and the best of each size."""
