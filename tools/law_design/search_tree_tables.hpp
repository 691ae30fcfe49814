// A built search tree as the tables of a law file: each leaf one piece.
#pragma once

#include "law_design/search_tree.hpp"
#include "service/law_tables.hpp"

namespace eampc::law_design {

service::LawTables law_tables(const BuiltSearchTree& tree);

}  // namespace eampc::law_design
