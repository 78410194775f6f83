// Crosses the Rust border: passes::probe_object::TransferConstants.
layout(push_constant) uniform TransferConstants {
    uint vertices;
    uint invocations; // each does its own vertex and those so many behind it
} transfer;
