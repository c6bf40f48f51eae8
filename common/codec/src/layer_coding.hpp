// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>

#include "grid.hpp"
#include "range_coder.hpp"

namespace telefab::codec {

/// A layer on the lattice: what goes into a chunk.
struct GridLayer {
  std::vector<std::vector<GridPoint>> rings;
  LayerCertificate certificate;
};

/// Certificates of codings 5 and 6 say in words why a layer is flagged, and rings do not say what they rest on.
enum class CertificateForm : std::uint8_t { InWords = 1, Enumerated = 2 };

/// The adaptive state of one chunk, shared by the layers in it; the encoder's and the decoder's move alike.
struct ChunkModels {
  NumberModel<8> small;       ///< counts and the certificate's numbers
  NumberModel<258> residual;  ///< of vertices, along and across the edge before, by the sizes of those before
  NumberModel<1> text;        ///< of certificates in words
  NumberModel<16> note;       ///< ground and doubt of a certificate, and runs
  BitModel has_runs[2];       ///< any ring of the layer: by the layer below
  BitModel flags[4];
  std::vector<GridPoint> firsts;  ///< first vertices of the rings of the layer below
  bool had_runs = false;          ///< the layer below
};

void encode_certificate(RangeEncoder& coder, ChunkModels& models, const LayerCertificate& certificate);
[[nodiscard]] Result<LayerCertificate> decode_certificate(RangeDecoder& coder, ChunkModels& models,
                                                          CertificateForm form);
/// The certificate as decoders will see it: lengths to the micrometre.
[[nodiscard]] LayerCertificate as_coded(LayerCertificate certificate);

/// What the rings of one layer rest on, given in the order in which decoders have the rings. Lengths to 10 micrometres.
void encode_runs(RangeEncoder& coder, ChunkModels& models, std::span<const Contour> rings);
/// The same rings with their runs. Fails with ProtocolBroken.
[[nodiscard]] Result<std::vector<Contour>> decode_runs(RangeDecoder& coder, ChunkModels& models,
                                                       std::vector<Contour> rings);
/// The run as decoders will see it.
[[nodiscard]] SurfaceRun as_coded(SurfaceRun run);

/// One ring, its first vertex against `guess`. Decoding fails with ProtocolBroken.
void encode_ring(RangeEncoder& coder, ChunkModels& models, const std::vector<GridPoint>& ring, GridPoint guess);
[[nodiscard]] Result<std::vector<GridPoint>> decode_ring(RangeDecoder& coder, ChunkModels& models, GridPoint guess,
                                                         GridPoint most, std::uint64_t& budget);

void encode_layer(RangeEncoder& coder, ChunkModels& models, const GridLayer& layer);

/// Fails with ProtocolBroken. `budget` is the number of vertices that may still be made; it is drawn from before memory
/// is taken.
[[nodiscard]] Result<GridLayer> decode_layer(RangeDecoder& coder, ChunkModels& models, CertificateForm form,
                                             GridPoint most, std::uint64_t& budget);

}  // namespace telefab::codec
