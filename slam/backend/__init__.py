"""Keyframes, loops and wheels made one: the pose graph, the joint adjustment, sessions joined."""
