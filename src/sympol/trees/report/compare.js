// Several policies beside each other.
