"""The EKF and the iterated EKF of pesce2017: error state, transition, observation, update, run."""
