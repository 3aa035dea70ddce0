"""Episodes as moving pictures: the environment, beside it the tree with the way of each observation lit."""
