"""PTP (ISO 15740): code tables, containers, datasets and sessions; no instrument in particular."""
