"""The principal frame and the error-state EKF of hu2024."""
