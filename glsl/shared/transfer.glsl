// Crosses the Rust border: passes::probe_object::TransferConstants.
layout(push_constant) uniform TransferConstants {
    uint vertices;
} transfer;
