// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <telefab/codec/tfc_file.hpp>

namespace telefab {
namespace {

constexpr std::string_view kMagic = "TFC1\r\n\x1a\n";  // the line ends show a transfer that translated them
enum class Record : std::uint8_t { Header = 'H', Chunk = 'C', End = 'E' };
constexpr std::size_t kRecordHead = 5;  // type, length
constexpr std::size_t kChecksum = 4;
constexpr std::uint32_t kMaxRecordBytes = 4U << 20U;

/// Little-endian numbers and counted texts into bytes.
class Writer {
 public:
  Writer& number(std::uint64_t value, unsigned bytes) {
    for (unsigned i = 0; i < bytes; ++i) bytes_.push_back(static_cast<std::byte>(value >> (8 * i)));
    return *this;
  }
  Writer& real(double value) { return number(std::bit_cast<std::uint64_t>(value), 8); }
  Writer& raw(std::span<const std::byte> bytes) {
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
    return *this;
  }
  Writer& text(std::string_view text) { return number(text.size(), 4).raw(std::as_bytes(std::span{text})); }
  [[nodiscard]] const std::vector<std::byte>& bytes() const { return bytes_; }

 private:
  std::vector<std::byte> bytes_;
};

/// The other way; past the end it gives zeros and `ok()` turns false.
class Reader {
 public:
  explicit Reader(std::span<const std::byte> bytes) : bytes_{bytes} {}
  std::uint64_t number(unsigned size) {
    const auto from = raw(size);
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < from.size(); ++i) value |= std::to_integer<std::uint64_t>(from[i]) << (8 * i);
    return value;
  }
  std::uint32_t number32() { return static_cast<std::uint32_t>(number(4)); }
  double real() { return std::bit_cast<double>(number(8)); }
  std::span<const std::byte> raw(std::size_t size) {
    if (size > bytes_.size()) {
      ok_ = false;
      return {};
    }
    const auto from = bytes_.first(size);
    bytes_ = bytes_.subspan(size);
    return from;
  }
  std::string text() {
    const auto from = raw(number(4));
    return {reinterpret_cast<const char*>(from.data()), from.size()};
  }
  Digest digest() {
    Digest d;
    const auto from = raw(d.bytes.size());
    std::copy(from.begin(), from.end(), d.bytes.begin());
    return d;
  }
  [[nodiscard]] bool ok() const { return ok_; }
  [[nodiscard]] bool done() const { return ok_ && bytes_.empty(); }

 private:
  std::span<const std::byte> bytes_;
  bool ok_ = true;
};

std::uint32_t checksum(std::span<const std::byte> bytes) {
  return static_cast<std::uint32_t>(::crc32_z(0, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size()));
}

std::vector<std::byte> record(Record type, const Writer& body) {
  Writer whole;
  whole.number(static_cast<std::uint8_t>(type), 1).number(body.bytes().size(), 4).raw(body.bytes());
  whole.number(checksum(whole.bytes()), 4);
  return whole.bytes();
}

Writer header_body(const StackHeader& h) {
  Writer body;
  body.number(h.layer_count, 4).real(h.layer_thickness_mm).real(h.pixel_pitch_mm);
  body.real(h.bounds.min.x_mm).real(h.bounds.min.y_mm).real(h.bounds.max.x_mm).real(h.bounds.max.y_mm);
  for (const double t : h.scan_to_build) body.real(t);
  body.text(h.machine).text(h.scan_name);
  return body;
}

Writer chunk_body(const Chunk& chunk, const Digest& chain) {
  Writer body;
  body.number(chunk.sequence, 4).number(chunk.first_layer.count(), 4).number(chunk.layer_count, 4);
  body.raw(chain.bytes).raw(chunk.payload);
  return body;
}

Writer end_body(std::uint32_t chunks, const Digest& chain, const Digest& stack) {
  Writer body;
  body.number(chunks, 4).raw(chain.bytes).raw(stack.bytes);
  return body;
}

/// What every file begins with.
std::vector<std::byte> head_of(const StackHeader& header) {
  return Writer{}.raw(std::as_bytes(std::span{kMagic})).raw(record(Record::Header, header_body(header))).bytes();
}

StackHeader read_header(Reader& from) {
  StackHeader h;
  h.layer_count = from.number32();
  h.layer_thickness_mm = from.real();
  h.pixel_pitch_mm = from.real();
  for (double* side : {&h.bounds.min.x_mm, &h.bounds.min.y_mm, &h.bounds.max.x_mm, &h.bounds.max.y_mm})
    *side = from.real();
  for (double& t : h.scan_to_build) t = from.real();
  h.machine = from.text();
  h.scan_name = from.text();
  return h;
}

}  // namespace

Result<TfcWriter> TfcWriter::start(StackHeader header, const CodecOptions& options, ByteSink sink) {
  auto encoder = StackEncoder::start(header, options);
  if (!encoder) return tl::unexpected{encoder.error()};
  if (auto done = sink(head_of(header)); !done) return tl::unexpected{done.error()};
  return TfcWriter{std::move(*encoder), ChunkChain{header}, std::move(sink)};
}

Result<void> TfcWriter::write(const Chunk& chunk) {
  ++chunks_;
  return sink_(record(Record::Chunk, chunk_body(chunk, chain_.add(chunk))));
}

Result<void> TfcWriter::add(const Layer& layer) {
  const auto chunk = encoder_.add(layer);
  if (!chunk) return tl::unexpected{chunk.error()};
  return *chunk ? write(**chunk) : Result<void>{};
}

Result<Digest> TfcWriter::finish() {
  const auto chunk = encoder_.finish();
  if (!chunk) return tl::unexpected{chunk.error()};
  if (*chunk)
    if (auto done = write(**chunk); !done) return tl::unexpected{done.error()};
  const Digest stack = encoder_.stack_digest();
  if (auto done = sink_(record(Record::End, end_body(chunks_, chain_.value(), stack))); !done)
    return tl::unexpected{done.error()};
  return stack;
}

Result<std::vector<std::byte>> write_tfc(const LayerStack& stack, const CodecOptions& options) {
  std::vector<std::byte> bytes;
  auto writer = TfcWriter::start(stack.header(), options, [&](std::span<const std::byte> more) -> Result<void> {
    bytes.insert(bytes.end(), more.begin(), more.end());
    return {};
  });
  if (!writer) return tl::unexpected{writer.error()};
  for (const Layer& layer : stack.layers())
    if (auto done = writer->add(layer); !done) return tl::unexpected{done.error()};
  if (auto done = writer->finish(); !done) return tl::unexpected{done.error()};
  return bytes;
}

std::vector<std::byte> tfc_of(const StackHeader& header, std::span<const Chunk> chunks, const Digest& stack) {
  std::vector<std::byte> bytes = head_of(header);
  const auto add = [&](std::span<const std::byte> more) { bytes.insert(bytes.end(), more.begin(), more.end()); };
  ChunkChain chain{header};
  for (const Chunk& chunk : chunks) add(record(Record::Chunk, chunk_body(chunk, chain.add(chunk))));
  add(record(Record::End, end_body(static_cast<std::uint32_t>(chunks.size()), chain.value(), stack)));
  return bytes;
}

bool is_tfc(std::span<const std::byte> bytes) {
  constexpr std::size_t kWord = 4;
  return bytes.size() >= kWord && std::memcmp(bytes.data(), kMagic.data(), kWord) == 0;
}

Result<LayerStack> read_tfc(std::span<const std::byte> bytes) {
  std::size_t at = 0;
  const auto bad = [&](std::string what) {
    return fail(ErrorCode::InvalidInput, fmt::format("contour file (.tfc), byte {}: {}", at, what));
  };
  if (bytes.size() < kMagic.size() || std::memcmp(bytes.data(), kMagic.data(), kMagic.size()) != 0)
    return bad("this is not a .tfc file of version 1; make one with telefab-scan slice --out");
  at = kMagic.size();

  std::optional<StackDecoder> decoder;
  std::optional<ChunkChain> chain;
  std::vector<Layer> layers;
  std::uint32_t chunks = 0;
  bool earlier = false;
  while (true) {
    if (bytes.size() - at < kRecordHead + kChecksum) return bad("the file is cut off; copy or slice it again");
    Reader head{bytes.subspan(at, kRecordHead)};
    const auto type = static_cast<Record>(head.number(1));
    const std::uint32_t length = head.number32();
    if (length > kMaxRecordBytes) return bad(fmt::format("a record of {} bytes is impossible", length));
    if (bytes.size() - at - kRecordHead - kChecksum < length) return bad("the file is cut off; copy or slice it again");
    const auto whole = bytes.subspan(at, kRecordHead + length);
    if (Reader{bytes.subspan(at + whole.size(), kChecksum)}.number32() != checksum(whole))
      return bad("a record is damaged (checksum)");
    Reader body{whole.subspan(kRecordHead)};

    if (type == Record::Header && !decoder) {
      StackHeader header = read_header(body);
      if (!body.done()) return bad("the header is malformed");
      auto started = StackDecoder::start(header);
      if (!started) return bad(started.error().what);
      chain.emplace(header);
      decoder = std::move(*started);
    } else if (type == Record::Chunk && decoder) {
      Chunk chunk;
      chunk.sequence = body.number32();
      chunk.first_layer = LayerIndex{body.number32()};
      chunk.layer_count = body.number32();
      const Digest stated = body.digest();
      if (!body.ok()) return bad("a chunk is malformed");
      const auto payload = whole.subspan(kRecordHead + 12 + stated.bytes.size());
      chunk.payload.assign(payload.begin(), payload.end());
      if (chunk.sequence != chunks || chunk.first_layer.count() != layers.size())
        return bad(fmt::format("chunk {} is missing or out of order", chunks));
      if (chain->add(chunk) != stated)
        return bad(fmt::format("chunk {} does not belong to this stack (digest chain)", chunks));
      auto decoded = decoder->decode(chunk);
      if (!decoded) return bad(decoded.error().what);
      std::move(decoded->begin(), decoded->end(), std::back_inserter(layers));
      earlier |= is_of_earlier_release(chunk);
      ++chunks;
    } else if (type == Record::End && decoder) {
      const std::uint32_t count = body.number32();
      const Digest last = body.digest();
      const Digest stated = body.digest();
      if (!body.done()) return bad("the end record is malformed");
      if (count != chunks || last != chain->value()) return bad("chunks are missing (digest chain)");
      if (at + whole.size() + kChecksum != bytes.size()) return bad("bytes follow the end record");
      auto stack = LayerStack::from_layers(decoder->header(), std::move(layers));
      if (!stack) return bad(stack.error().what);
      if (!earlier && digest_of(*stack) != stated)
        return bad("the layers are not those that were written (stack digest)");
      return stack;
    } else {
      return bad(fmt::format("a record of type {} does not belong here", static_cast<int>(type)));
    }
    at += whole.size() + kChecksum;
  }
}

}  // namespace telefab
