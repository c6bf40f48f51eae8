// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/test/e57_file.hpp>

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <bit>

namespace telefab::test {
namespace {

constexpr std::size_t kPage = 1024;
constexpr std::size_t kPayload = kPage - 4;

template <class T>
void put(std::string& out, T value) {
  const auto raw = std::bit_cast<std::array<char, sizeof(T)>>(value);
  out.append(raw.data(), raw.size());
}

template <class T>
void put_at(std::string& out, std::size_t at, T value) {
  const auto raw = std::bit_cast<std::array<char, sizeof(T)>>(value);
  std::copy(raw.begin(), raw.end(), out.begin() + static_cast<std::ptrdiff_t>(at));
}

std::uint64_t physical(std::uint64_t logical) { return logical / kPayload * kPage + logical % kPayload; }

/// Bit by bit, by the definition.
std::uint32_t crc_of(std::string_view bytes) {
  std::uint32_t crc = ~0U;
  for (const char c : bytes) {
    crc ^= static_cast<unsigned char>(c);
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1U) ^ ((crc & 1U) ? 0x82F63B78U : 0U);
  }
  return ~crc;
}

std::string packed(std::span<const std::int64_t> values, std::int64_t least, std::int64_t most) {
  const auto width =
      static_cast<unsigned>(std::bit_width(static_cast<std::uint64_t>(most) - static_cast<std::uint64_t>(least)));
  std::string stream((values.size() * width + 7) / 8, '\0');
  std::size_t at = 0;
  for (const std::int64_t value : values) {
    const std::uint64_t raw = static_cast<std::uint64_t>(value) - static_cast<std::uint64_t>(least);
    for (unsigned bit = 0; bit < width; ++bit, ++at)
      if ((raw >> bit) & 1U) stream[at / 8] = static_cast<char>(stream[at / 8] | (1 << (at % 8)));
  }
  return stream;
}

}  // namespace

E57Column e57_doubles(std::string_view name, std::span<const double> values) {
  E57Column column{fmt::format(R"(<{} type="Float"/>)", name), {}};
  for (const double v : values) put(column.stream, v);
  return column;
}

E57Column e57_floats(std::string_view name, std::span<const double> values) {
  E57Column column{fmt::format(R"(<{} type="Float" precision="single"/>)", name), {}};
  for (const double v : values) put(column.stream, static_cast<float>(v));
  return column;
}

E57Column e57_integers(std::string_view name, std::span<const std::int64_t> values, std::int64_t least,
                       std::int64_t most) {
  return {fmt::format(R"(<{} type="Integer" minimum="{}" maximum="{}"/>)", name, least, most),
          packed(values, least, most)};
}

E57Column e57_scaled(std::string_view name, std::span<const std::int64_t> values, std::int64_t least, std::int64_t most,
                     double scale, double offset) {
  return {fmt::format(R"(<{} type="ScaledInteger" minimum="{}" maximum="{}" scale="{}" offset="{}"/>)", name, least,
                      most, scale, offset),
          packed(values, least, most)};
}

void E57File::add_scan(const std::vector<E57Column>& columns, std::uint64_t records, std::string_view pose,
                       std::size_t stream_bytes) {
  const std::size_t section = body_.size();
  body_.append(32, '\0');
  std::size_t longest = 0;
  for (const E57Column& c : columns) longest = std::max(longest, c.stream.size());
  for (std::size_t from = 0; from == 0 || from < longest; from += stream_bytes) {
    std::string packet{"\x01\x00\x00\x00", 4};
    put(packet, static_cast<std::uint16_t>(columns.size()));
    std::string streams;
    for (const E57Column& c : columns) {
      const std::string part = from < c.stream.size() ? c.stream.substr(from, stream_bytes) : std::string{};
      put(packet, static_cast<std::uint16_t>(part.size()));
      streams += part;
    }
    packet += streams;
    packet.append((4 - packet.size() % 4) % 4, '\0');
    put_at(packet, 2, static_cast<std::uint16_t>(packet.size() - 1));
    body_ += packet;
    if (from > 0) continue;
    body_.append("\x00\x00\x0F\x00", 4).append(12, '\0');  // an index packet without entries
    body_ += std::string{"\x02\x00\x07\x00", 4} + "left";  // an ignored packet
  }
  body_[section] = 1;
  put_at(body_, section + 8, std::uint64_t{body_.size() - section});
  put_at(body_, section + 16, physical(section + 32));
  scans_xml_ += fmt::format(R"(<vectorChild type="Structure"><guid type="String">{{{}}}</guid>)", section);
  if (!pose.empty()) scans_xml_ += fmt::format(R"(<pose type="Structure">{}</pose>)", pose);
  scans_xml_ +=
      fmt::format(R"(<points type="CompressedVector" fileOffset="{}" recordCount="{}"><prototype type="Structure">)",
                  physical(section), records);
  for (const E57Column& c : columns) scans_xml_ += c.element;
  scans_xml_ += R"(</prototype><codecs type="Vector" allowHeterogeneousChildren="1"></codecs></points></vectorChild>)";
}

std::string E57File::logical() const {
  const std::string xml = fmt::format(
      R"(<?xml version="1.0" encoding="UTF-8"?><e57Root type="Structure" xmlns="http://www.astm.org/COMMIT/E57/2010-e57-v1.0" xmlns:nor="http://www.libe57.org/E57_NOR_surface_normals.txt"><formatName type="String">ASTM E57 3D Imaging Data File</formatName><guid type="String">{{made in a test}}</guid><versionMajor type="Integer">1</versionMajor><versionMinor type="Integer"/><data3D type="Vector" allowHeterogeneousChildren="1">{}</data3D><images2D type="Vector" allowHeterogeneousChildren="1"/>{}</e57Root>)",
      scans_xml_, more_xml_);
  std::string all = body_;
  std::copy_n("ASTM-E57", 8, all.begin());
  put_at(all, 8, std::uint32_t{1});
  put_at(all, 24, physical(all.size()));
  put_at(all, 32, std::uint64_t{xml.size()});
  return all + xml;
}

std::string E57File::bytes() const { return on_e57_pages(logical()); }

std::string on_e57_pages(std::string logical) {
  const std::size_t pages = (logical.size() + kPayload - 1) / kPayload;
  logical.resize(pages * kPayload);
  put_at(logical, 16, std::uint64_t{pages * kPage});
  put_at(logical, 40, std::uint64_t{kPage});
  std::string file;
  for (std::size_t i = 0; i < pages; ++i) {
    const std::string page = logical.substr(i * kPayload, kPayload);
    auto crc = std::bit_cast<std::array<char, 4>>(crc_of(page));
    std::reverse(crc.begin(), crc.end());
    file += page;
    file.append(crc.data(), crc.size());
  }
  return file;
}

}  // namespace telefab::test
