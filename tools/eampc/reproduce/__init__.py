"""The paper's comparison: both cases, EAMPC and min-max MPC, figures 2 to 9, tables II and III."""
