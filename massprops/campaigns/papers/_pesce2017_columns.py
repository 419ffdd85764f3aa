"""What a run of pesce2017 reports of itself."""

COLUMNS = ("rho_m", "rho_dot_m_s", "omega_deg_s", "theta_deg", "k1", "k2")
