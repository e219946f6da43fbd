"""The mechanism as a tree of single motions, and its dynamics reflected to independent rates."""
