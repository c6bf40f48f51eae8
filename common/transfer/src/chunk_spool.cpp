// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <telefab/base/damaged_file.hpp>
#include <telefab/base/file.hpp>
#include <telefab/transfer/chunk_spool.hpp>

namespace telefab {
namespace {

// A record: mark (4), sequence (4), first layer (4), layer count (4), payload size (4), chain (32), CRC-32 of all that
// and the payload (4), payload. The last record of a finished spool has the mark "TFse", no payload and the digest of
// the stack in place of the chain.
constexpr std::uint32_t kChunkMark = 0x63734654;  // "TFsc"
constexpr std::uint32_t kEndMark = 0x65734654;    // "TFse"
constexpr std::size_t kHeadBytes = 56;
constexpr std::uint32_t kMaxPayloadBytes = 4U << 20U;

struct Head {
  std::uint32_t mark = 0;
  std::uint32_t sequence = 0;
  std::uint32_t first_layer = 0;
  std::uint32_t layer_count = 0;
  std::uint32_t size = 0;
  Digest digest;
};

void put(std::byte* at, std::uint32_t value) {
  for (int i = 0; i < 4; ++i) at[i] = static_cast<std::byte>(value >> (8 * i));
}
std::uint32_t get(const std::byte* at) {
  std::uint32_t value = 0;
  for (int i = 0; i < 4; ++i) value |= static_cast<std::uint32_t>(at[i]) << (8 * i);
  return value;
}

std::uint32_t crc_of(std::span<const std::byte> head, std::span<const std::byte> payload) {
  uLong crc = crc32(0, reinterpret_cast<const Bytef*>(head.data()), kHeadBytes - 4);
  if (!payload.empty())
    crc = crc32(crc, reinterpret_cast<const Bytef*>(payload.data()), static_cast<uInt>(payload.size()));
  return static_cast<std::uint32_t>(crc);
}

std::vector<std::byte> to_record(const Head& head, std::span<const std::byte> payload) {
  std::vector<std::byte> record(kHeadBytes + payload.size());
  put(&record[0], head.mark);
  put(&record[4], head.sequence);
  put(&record[8], head.first_layer);
  put(&record[12], head.layer_count);
  put(&record[16], head.size);
  std::copy(head.digest.bytes.begin(), head.digest.bytes.end(), record.begin() + 20);
  std::copy(payload.begin(), payload.end(), record.begin() + kHeadBytes);
  put(&record[52], crc_of(record, payload));
  return record;
}

/// Empty where the bytes are no whole, sound record.
std::optional<Head> head_of(std::span<const std::byte> bytes) {
  if (bytes.size() < kHeadBytes) return {};
  Head head{get(&bytes[0]), get(&bytes[4]), get(&bytes[8]), get(&bytes[12]), get(&bytes[16]), {}};
  if ((head.mark != kChunkMark && head.mark != kEndMark) || head.size > kMaxPayloadBytes) return {};
  std::copy_n(bytes.begin() + 20, head.digest.bytes.size(), head.digest.bytes.begin());
  return head;
}

}  // namespace

Digest chain_after(const Digest& before, std::uint32_t sequence, LayerIndex first_layer, std::uint32_t layer_count,
                   std::span<const std::byte> payload) {
  Hasher hasher;
  hasher.feed(before.bytes);
  std::array<std::byte, 12> numbers{};
  put(&numbers[0], sequence);
  put(&numbers[4], first_layer.count());
  put(&numbers[8], layer_count);
  hasher.feed(numbers);
  hasher.feed(payload);
  return hasher.digest();
}

struct ChunkSpool::Impl {
  std::filesystem::path path;
  int file = -1;
  struct Place {
    std::uint64_t offset;
    Head head;
  };
  std::vector<Place> places;
  std::uint64_t end = 0;
  std::uint32_t layers = 0;
  std::uint64_t payload_bytes = 0;
  Digest chain{};
  std::optional<Digest> finished;
  std::optional<std::filesystem::path> damaged;

  Impl() = default;
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    if (file >= 0) ::close(file);
  }

  /// The job's folder is ours: if it is gone the disk is at fault, and not who asked.
  [[nodiscard]] tl::unexpected<Error> storage_failed(std::string_view operation) const {
    auto failed = fail_system(operation, path, errno);
    if (failed.value().code == ErrorCode::NotFound) failed.value().code = ErrorCode::StorageFailed;
    return failed;
  }

  [[nodiscard]] Result<std::vector<std::byte>> bytes_at(std::uint64_t offset, std::size_t size) const {
    std::vector<std::byte> bytes(size);
    std::size_t got = 0;
    while (got < size) {
      const ssize_t n = ::pread(file, bytes.data() + got, size - got, static_cast<off_t>(offset + got));
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return storage_failed("read");
      if (n == 0) break;
      got += static_cast<std::size_t>(n);
    }
    bytes.resize(got);
    return bytes;
  }

  /// Appends and returns when it is durable; on failure the file is as before.
  [[nodiscard]] Result<void> write(std::span<const std::byte> record) {
    std::size_t put_bytes = 0;
    while (put_bytes < record.size()) {
      const ssize_t n =
          ::pwrite(file, record.data() + put_bytes, record.size() - put_bytes, static_cast<off_t>(end + put_bytes));
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) {
        auto error = storage_failed("write");
        // Where this fails too, the next record is written over the torn one, or the next opening cuts it.
        if (::ftruncate(file, static_cast<off_t>(end)) != 0) error.value().what += "; nor could it be shortened again";
        return error;
      }
      put_bytes += static_cast<std::size_t>(n);
    }
    if (::fdatasync(file) != 0) return storage_failed("sync");
    end += record.size();
    return {};
  }

  void take(const Head& head, std::uint64_t offset) {
    places.push_back({offset, head});
    layers += head.layer_count;
    payload_bytes += head.size;
    chain = head.digest;
  }

  /// Whether a writer that was stopped anywhere could have left what stands behind the sound records: the beginning of
  /// the next one, or zeros, as a loss of power leaves them.
  [[nodiscard]] Result<bool> is_tail_torn(std::uint64_t size) const {
    constexpr std::size_t kLooked = kHeadBytes + kMaxPayloadBytes;
    const auto bytes = bytes_at(end, static_cast<std::size_t>(std::min<std::uint64_t>(size - end, kLooked)));
    if (!bytes) return tl::unexpected{bytes.error()};
    const auto is_zero = [](std::byte b) { return b == std::byte{0}; };
    if (std::all_of(bytes->begin(), bytes->end(), is_zero)) return true;
    if (bytes->size() < kHeadBytes) {
      std::array<std::byte, 4> marks[2]{};
      put(marks[0].data(), kChunkMark);
      put(marks[1].data(), kEndMark);
      const auto n = static_cast<std::ptrdiff_t>(std::min<std::size_t>(4, bytes->size()));
      return std::any_of(std::begin(marks), std::end(marks),
                         [&](const auto& mark) { return std::equal(mark.begin(), mark.begin() + n, bytes->begin()); });
    }
    const auto head = head_of(*bytes);
    if (!head || head->sequence != places.size() || head->first_layer != layers) return false;
    const std::uint64_t whole = end + kHeadBytes + head->size;
    return whole > size || (whole == size && head->size > 0 && is_zero(bytes->back()));
  }

  /// Takes what the heads tell, up to the first that does not follow.
  [[nodiscard]] Result<void> walk() {
    struct stat status {};
    if (::fstat(file, &status) != 0) return storage_failed("look at");
    const auto size = static_cast<std::uint64_t>(status.st_size);
    while (!finished && end < size) {
      const auto bytes = bytes_at(end, kHeadBytes);
      if (!bytes) return tl::unexpected{bytes.error()};
      const auto head = head_of(*bytes);
      if (!head || end + kHeadBytes + head->size > size || head->sequence != places.size() ||
          head->first_layer != layers)
        break;
      if (head->mark == kEndMark)
        finished = head->digest;
      else
        take(*head, end);
      end += kHeadBytes + head->size;
    }
    return {};
  }

  /// Reads every record; cuts off a torn tail, and keeps a damaged file aside before it goes on behind what is sound.
  [[nodiscard]] Result<void> load() {
    struct stat status {};
    if (::fstat(file, &status) != 0) return storage_failed("look at");
    const auto size = static_cast<std::uint64_t>(status.st_size);
    while (end < size) {
      auto bytes = bytes_at(end, kHeadBytes);
      if (!bytes) return tl::unexpected{bytes.error()};
      const auto head = head_of(*bytes);
      if (!head || end + kHeadBytes + head->size > size) break;
      auto payload = bytes_at(end + kHeadBytes, head->size);
      if (!payload) return tl::unexpected{payload.error()};
      if (crc_of(*bytes, *payload) != get(&(*bytes)[52])) break;
      if (finished) return fail(ErrorCode::NotTrusted, fmt::format("{} goes on behind its end", path.string()));
      if (head->mark == kEndMark) {
        finished = head->digest;
      } else {
        const Digest expected =
            chain_after(chain, head->sequence, LayerIndex{head->first_layer}, head->layer_count, *payload);
        if (head->sequence != places.size() || head->first_layer != layers || head->digest != expected)
          return fail(ErrorCode::NotTrusted,
                      fmt::format("chunk {} of {} does not follow the one before it", head->sequence, path.string()));
        take(*head, end);
      }
      end += kHeadBytes + head->size;
    }
    if (end == size) return {};
    const auto torn = is_tail_torn(size);
    if (!torn) return tl::unexpected{torn.error()};
    if (!*torn) {
      auto aside = copy_damaged(path);
      if (!aside) return tl::unexpected{aside.error()};
      damaged = std::move(*aside);
    }
    if (::ftruncate(file, static_cast<off_t>(end)) != 0) return storage_failed("shorten");
    return {};
  }
};

Result<ChunkSpool> ChunkSpool::look_into(const std::filesystem::path& path) {
  auto impl = std::make_unique<Impl>();
  impl->path = path;
  impl->file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (impl->file < 0) return fail_system("read", path, errno);
  if (auto walked = impl->walk(); !walked) return tl::unexpected{walked.error()};
  return ChunkSpool{std::move(impl)};
}

ChunkSpool::ChunkSpool(std::unique_ptr<Impl> impl) : impl_{std::move(impl)} {}
ChunkSpool::~ChunkSpool() = default;
ChunkSpool::ChunkSpool(ChunkSpool&&) noexcept = default;
ChunkSpool& ChunkSpool::operator=(ChunkSpool&&) noexcept = default;

Result<ChunkSpool> ChunkSpool::open(const std::filesystem::path& path) {
  auto impl = std::make_unique<Impl>();
  impl->path = path;
  impl->file = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0640);
  if (impl->file < 0) return impl->storage_failed("open");
  if (auto loaded = impl->load(); !loaded) return tl::unexpected{loaded.error()};
  // The entry in the folder must survive a loss of power too.
  (void)sync_folder_of(path);  // some file systems cannot; the next fdatasync of the file reports real trouble
  return ChunkSpool{std::move(impl)};
}

std::uint32_t ChunkSpool::chunk_count() const { return static_cast<std::uint32_t>(impl_->places.size()); }
std::uint32_t ChunkSpool::layer_count() const { return impl_->layers; }
std::uint64_t ChunkSpool::payload_bytes() const { return impl_->payload_bytes; }
Digest ChunkSpool::chain() const { return impl_->chain; }
const std::optional<std::filesystem::path>& ChunkSpool::damaged() const { return impl_->damaged; }
const std::optional<Digest>& ChunkSpool::finished() const { return impl_->finished; }

Result<Digest> ChunkSpool::append(LayerIndex first_layer, std::uint32_t layer_count,
                                  std::span<const std::byte> payload) {
  if (impl_->finished) return fail(ErrorCode::Conflict, fmt::format("{} is finished", impl_->path.string()));
  if (first_layer.count() != impl_->layers || layer_count == 0)
    return fail(ErrorCode::InvalidInput, fmt::format("a chunk of {} layers from layer {} does not follow layer {}",
                                                     layer_count, first_layer.count(), impl_->layers));
  if (payload.size() > kMaxPayloadBytes)
    return fail(ErrorCode::TooLarge,
                fmt::format("a chunk of {} bytes is above the limit of {}", payload.size(), kMaxPayloadBytes));
  Head head{kChunkMark, chunk_count(), first_layer.count(), layer_count, static_cast<std::uint32_t>(payload.size()),
            {}};
  head.digest = chain_after(impl_->chain, head.sequence, first_layer, layer_count, payload);
  const std::uint64_t offset = impl_->end;
  if (auto written = impl_->write(to_record(head, payload)); !written) return tl::unexpected{written.error()};
  impl_->take(head, offset);
  return head.digest;
}

Result<std::uint32_t> ChunkSpool::sequence_of(LayerIndex layer) const {
  if (layer.count() >= impl_->layers)
    return fail(ErrorCode::NotFound, fmt::format("{} has no layer {}", impl_->path.string(), layer.count()));
  const auto behind =
      std::upper_bound(impl_->places.begin(), impl_->places.end(), layer.count(),
                       [](std::uint32_t wanted, const Impl::Place& place) { return wanted < place.head.first_layer; });
  return static_cast<std::uint32_t>(behind - impl_->places.begin() - 1);
}

Result<SpooledChunk> ChunkSpool::read(std::uint32_t sequence) const {
  if (sequence >= impl_->places.size())
    return fail(ErrorCode::NotFound, fmt::format("{} has no chunk {}", impl_->path.string(), sequence));
  const auto& place = impl_->places[sequence];
  auto bytes = impl_->bytes_at(place.offset + kHeadBytes, place.head.size);
  if (!bytes) return tl::unexpected{bytes.error()};
  const Digest before = sequence == 0 ? Digest{} : impl_->places[sequence - 1].head.digest;
  const LayerIndex first{place.head.first_layer};
  if (chain_after(before, sequence, first, place.head.layer_count, *bytes) != place.head.digest)
    return fail(ErrorCode::NotTrusted,
                fmt::format("chunk {} of {} was changed on disk", sequence, impl_->path.string()));
  return SpooledChunk{sequence, first, place.head.layer_count, std::move(*bytes), place.head.digest};
}

Result<void> ChunkSpool::finish(const Digest& stack) {
  if (impl_->finished) {
    if (*impl_->finished == stack) return {};
    return fail(ErrorCode::Conflict, fmt::format("{} is finished with another stack", impl_->path.string()));
  }
  if (auto written = impl_->write(to_record({kEndMark, chunk_count(), impl_->layers, 0, 0, stack}, {})); !written)
    return written;
  impl_->finished = stack;
  return {};
}

}  // namespace telefab
